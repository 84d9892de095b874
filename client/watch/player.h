// Plays recordings into the view, at any speed and from any place.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "client/watch/view.h"

namespace teletact::client {

// Whether a recording begins, or goes on: not before somebody looks.
inline bool plays(bool recording, std::size_t viewers) {
  return recording && viewers > 0;
}

class Player {
 public:
  static constexpr double kSlowest = 0.01, kFastest = 100;

  // Reads them once: which states there were, and when. Throws std::runtime_error, one line, when one cannot
  // be read.
  Player(std::vector<std::string> paths, View& view);
  ~Player();
  Player(const Player&) = delete;
  Player& operator=(const Player&) = delete;

  // Whether one of them holds its scene's maps.
  bool has_maps() const { return has_maps_; }
  // Somebody looks. It stands at its beginning until then.
  void begin();
  // {"speed": 0 or kSlowest to kFastest}, {"seek_s": since the beginning}; what else it says is nothing here.
  void obey(const nlohmann::json& order);

 private:
  struct Orders {
    double speed = 1;
    std::optional<double> seek_s;
    bool begun = false, stop = false;
  };
  void index();
  void run();
  void play(double from_s);      // until an order comes for another place, or the end
  bool wait_until(double at_s);  // false: such an order is there. Infinity: until one is
  void say();
  double length_s() const;

  const std::vector<std::string> paths_;
  View& view_;
  std::int64_t begin_ns_ = 0, end_ns_ = 0;
  bool has_maps_ = false;
  double at_s_ = 0;
  bool over_ = false;  // all of it has been shown
  std::mutex mutex_;
  std::condition_variable changed_;
  Orders orders_;
  std::thread thread_;
};

}  // namespace teletact::client
