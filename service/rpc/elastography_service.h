// RF pairs in, maps out, windows published.
#pragma once

#include <memory>

#include "service/imaging/estimate.h"
#include "service/rpc/acquisition.h"
#include "service/rpc/core.h"
#include "teletact/v1/elastography.grpc.pb.h"

namespace teletact::service {

class ElastographyService final : public v1::Elastography::Service {
 public:
  explicit ElastographyService(Core&);
  // Compiles the kernels, on the imaging worker.
  void warm();
  grpc::Status Estimate(grpc::ServerContext*,
                        grpc::ServerReaderWriter<v1::EstimateResponse, v1::EstimateRequest>*) override;

 private:
  using Stream = grpc::ServerReaderWriter<v1::EstimateResponse, v1::EstimateRequest>;
  struct Job;
  struct Outcome;
  class Guard;
  static void receive(Stream&, Core&, Guard&, Job&);
  static void write_outcome(const Outcome&, const EstimateRequest&, Stream&);
  // On the imaging worker.
  Outcome work(Job&);
  Elastography& engine_for(double max_strain);
  Core& core_;
  // Used on the imaging worker alone: the default one, and one for the last other max_strain asked for.
  std::unique_ptr<Elastography> engine_, other_engine_;
  double other_max_strain_ = 0;
};

}  // namespace teletact::service
