// Where what is shown comes from: what sessions record, and the service that holds their scene.
#pragma once

#include <grpcpp/grpcpp.h>

#include <atomic>
#include <mutex>
#include <string>
#include <thread>

#include "client/link/credentials.h"
#include "client/link/recording.h"
#include "client/watch/view.h"

namespace teletact::client {

// Takes the entries of a session as it records them at `path`, from its beginning, and waits for it, or the
// next one, while there is none.
class SessionSource {
 public:
  // `name`: what the status calls it. `first`: another session there begins the view anew.
  SessionSource(std::string path, std::string name, bool first, View& view);
  ~SessionSource();
  SessionSource(const SessionSource&) = delete;
  SessionSource& operator=(const SessionSource&) = delete;

 private:
  void run();
  void follow(RecordReader& reader);

  const std::string path_, name_;
  const bool first_;
  View& view_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

// Looks on at the scene (Palpation.Observe): its windows, maps, and how the touched layer gives way.
class SceneSource {
 public:
  static constexpr double kRetryS = 0.2, kMaxRetryS = 5;  // after a stream has ended, and after refusals

  // `address`, `scene_id`: empty: as the session says.
  SceneSource(std::string address, Credentials credentials, std::string scene_id, View& view);
  ~SceneSource();
  SceneSource(const SceneSource&) = delete;
  SceneSource& operator=(const SceneSource&) = delete;

 private:
  void run();
  // Whose touch at which scene of which service.
  struct Wanted {
    std::string address, scene_id, session_id;
    bool operator==(const Wanted&) const = default;
  };
  Wanted wanted() const;
  // Until the stream ends, or something else is wanted.
  grpc::Status look_on(const Wanted&);

  const std::string address_;
  const Credentials credentials_;
  const std::string scene_id_;
  View& view_;
  std::atomic<bool> stop_{false};
  std::mutex mutex_;
  grpc::ClientContext* context_ = nullptr;  // of the open stream, to cancel it
  std::thread thread_;
};

}  // namespace teletact::client
