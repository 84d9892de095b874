// Where what is shown comes from: sessions that are published, and the service that holds their scene.
#pragma once

#include <atomic>
#include <string>
#include <thread>

#include "client/link/credentials.h"
#include "client/watch/view.h"

namespace teletact::client {

// Takes the entries of a session that is published at `path`, and waits for it, or the next one, while there
// is none.
class PublishedSource {
 public:
  // `name`: what the status calls it. `first`: another session there begins the view anew.
  PublishedSource(std::string path, std::string name, bool first, View& view);
  ~PublishedSource();
  PublishedSource(const PublishedSource&) = delete;
  PublishedSource& operator=(const PublishedSource&) = delete;

 private:
  void run();
  void read(int file);

  const std::string path_, name_;
  const bool first_;
  View& view_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

// Asks for the scene twice a second, and for its maps when its version is another.
class SceneSource {
 public:
  static constexpr double kEveryS = 0.5;

  // `address`, `scene_id`: empty: as the session says.
  SceneSource(std::string address, Credentials credentials, std::string scene_id, View& view);
  ~SceneSource();
  SceneSource(const SceneSource&) = delete;
  SceneSource& operator=(const SceneSource&) = delete;

 private:
  void run();

  const std::string address_;
  const Credentials credentials_;
  const std::string scene_id_;
  View& view_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace teletact::client
