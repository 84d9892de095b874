// One Estimate call. gRPC's threads put its upload together; the imaging plane works on it; the answer is
// written message by message, one in flight. No thread belongs to the call, and each of its waits has an end.
#pragma once

#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "service/base/memory.h"
#include "service/rpc/acquisition.h"
#include "service/rpc/core.h"
#include "service/rpc/served_call.h"
#include "teletact/v1/elastography.grpc.pb.h"

namespace teletact::service {

class EstimateReactor final
    : public ServedCall<grpc::ServerBidiReactor<v1::EstimateRequest, v1::EstimateResponse>> {
 public:
  EstimateReactor(Core&, grpc::CallbackServerContext*);
  static EstimateReactor* serve(Core&, grpc::CallbackServerContext*);

 private:
  void begun() override;
  void tick(Clock::time_point now) override;
  void ended() override;
  void closed() override;
  std::vector<StageTime> stages() const override;
  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;

  void receive();
  void require_authority(const v1::Acquisition&);
  void uploaded();
  JobTerms terms() const;  // whose call, and by when

  void work();  // on the imaging plane
  void log_done() const;
  void worked(const std::exception_ptr&);
  void progressed(v1::EstimateStage);
  // The stage of this name is over.
  void over(const char* stage);
  // Writes what is to be written next, if nothing is in flight; ends the call after the last of it.
  void go_on();
  bool next_message();

  Core& core_;
  const Clock::time_point opened_ = Clock::now();
  bool begun_ = false;  // it has its place

  // gRPC's reading thread; the imaging plane's from uploaded() on.
  v1::EstimateRequest message_;
  std::optional<EstimateRequest> request_;
  Charge upload_bytes_;
  std::optional<FrameUpload> upload_;
  Clock::time_point received_{};
  ImagingLane* lane_ = nullptr;  // where it is worked on
  JobTerms admitted_;            // of its job
  std::optional<EstimateOutcome> outcome_;

  mutable std::mutex mutex_;                                     // what follows
  std::vector<std::pair<const char*, Clock::time_point>> over_;  // stages, one after the other
  bool uploading_ = true, worked_ = false;
  double whole_upload_s_;  // at most, by what the acquisition declares
  Clock::time_point last_bytes_ = opened_;
  Workers::Id job_ = 0;
  std::deque<v1::EstimateProgress> progress_;
  std::size_t written_ = 0;      // messages of the outcome
  v1::EstimateResponse answer_;  // gRPC's, while a write is in flight
  std::optional<Clock::time_point> writing_since_;
};

class ElastographyService final : public v1::Elastography::CallbackService {
 public:
  explicit ElastographyService(Core& core) : core_(core) {}
  grpc::ServerBidiReactor<v1::EstimateRequest, v1::EstimateResponse>* Estimate(
      grpc::CallbackServerContext* context) override {
    return EstimateReactor::serve(core_, context);
  }

 private:
  Core& core_;
};

}  // namespace teletact::service
