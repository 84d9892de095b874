// One who looks on at a scene. It is written to when it is looked at (Calls::kTick): no thread waits for it.
#pragma once

#include <atomic>
#include <memory>
#include <optional>

#include "service/rpc/core.h"
#include "service/rpc/scene_news.h"
#include "service/rpc/served_call.h"
#include "service/touch_plane/observer.h"
#include "teletact/v1/palpation.pb.h"

namespace teletact::service {

namespace v1 = ::teletact::v1;

class ObserveReactor final : public ServedStream<v1::ObserveRequest, v1::Observation> {
 public:
  ObserveReactor(Core&, Workers&, grpc::CallbackServerContext*);
  // `copying`: makes what is large.
  static ObserveReactor* serve(Core&, Workers& copying, grpc::CallbackServerContext*);

 private:
  std::optional<Wanted> wanted(const v1::ObserveRequest&) const override;
  void take(const v1::ObserveRequest&) override;
  void tick(Clock::time_point now) override;
  void check() const override;
  void closed() override;

  void open(const v1::ObserveOpen&);

  Core& core_;
  Workers& copying_;
  const Clock::time_point begun_ = Clock::now();
  std::unique_ptr<Observer> observer_;
  std::unique_ptr<SceneNews> news_;
  std::atomic<bool> opened_{false};  // both are there
  v1::Observation state_;            // not touched while a write is under way
};

}  // namespace teletact::service
