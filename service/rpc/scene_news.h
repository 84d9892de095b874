// What one who looks on has of a scene's windows and maps, and what is new of them. It is made on a worker's
// thread, a message at a time: whoever looks after the calls copies no maps.
#pragma once

#include <atomic>
#include <exception>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "service/rpc/core.h"
#include "service/scene/workers.h"
#include "teletact/v1/palpation.pb.h"

namespace teletact::service {

namespace v1 = ::teletact::v1;

// By one thread.
class SceneNews {
 public:
  // Throws as ObservedMaps. `client`: to whom it is charged; `worker`: who makes it.
  SceneNews(const Core&, Workers& worker, std::shared_ptr<Scene>, std::string client, const v1::ObserveOpen&);
  ~SceneNews();  // what waits to be made is not made any more
  SceneNews(const SceneNews&) = delete;
  SceneNews& operator=(const SceneNews&) = delete;
  // Has the next made, where something is new, and none is being made or waits. Throws what making the last
  // threw, MemoryRefused among it.
  void look();
  bool ready() const;
  // Moves what is ready into the message; what it holds is returned once the next is taken.
  void take(v1::Observation&);

 private:
  // Shared with the work, which may outlive the call.
  struct Work;
  Workers& worker_;
  const std::shared_ptr<Work> work_;
  Workers::Id posted_ = 0;
  std::uint64_t version_ = 0;  // that was asked for last
  bool first_ = true;
  Charge sent_;
};

}  // namespace teletact::service
