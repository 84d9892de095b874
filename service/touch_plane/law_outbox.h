// What one stream is told of contact laws: columns near the finger first, in pieces small enough to go
// between answers, each once for each version of its window, and again once it is corrected, and no more than
// a few that nobody has acknowledged.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "service/contact/contact_laws.h"
#include "service/scene/scene.h"

namespace teletact::service {

// Columns of one version of a window's law, all of one lane.
struct LawPiece {
  std::uint64_t number = 0;  // counts the pieces of this stream from 1
  std::uint64_t window_id = 0, version = 0;
  // Between these the version rules: whoever holds columns of an older one there drops them.
  double begin_m = 0, end_m = 0;
  bool lanes = false;              // of a solid's law
  std::vector<LawColumn> columns;  // by x, one at least; all corrected, or none
};

// Where a finger is on a layer, or how it moves along it.
struct Along {
  double x = 0, z = 0;
};

class LawOutbox {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::uint64_t kMaxUnacknowledged = 8;

  // What is known of a window's law by now; null for nothing.
  using LawOf = std::function<std::shared_ptr<const ContactLaw>(const WindowModel&)>;

  // The next piece for a finger at a place that moves so fast, if it begins no farther than this from where
  // the finger will be soon; none where all is sent, or waits to be acknowledged. One thread.
  std::optional<LawPiece> next(const SceneSnapshot&, Along place_m, Along velocity_m_s, const LawOf&,
                               double farthest_m = std::numeric_limits<double>::infinity());
  // Whether there may soon be more to send.
  bool expects_more(Clock::time_point now) const;
  // Whether an older version's law was told of this window, and this one's, soon to be told, was not yet
  // around a place.
  bool owes(const WindowModel&, Along place_m) const;
  // By any thread. Throws std::invalid_argument for a piece that was not sent.
  void acknowledge(std::uint64_t pieces);

 private:
  struct Sent {
    std::uint64_t version = 0;
    bool lanes = false;  // its place along z matters
    std::shared_ptr<const ContactLaw> law;
    std::vector<bool> columns;  // that were sent as they are
    Clock::time_point since{};  // this version is looked at
    bool follows = false;       // an older one whose law was told
  };
  static void grow(Sent&, std::shared_ptr<const ContactLaw>);
  void look(const SceneSnapshot&, double x_m, const LawOf&);
  LawPiece piece_of(std::uint64_t window_id, Sent&, std::size_t nearest);

  std::map<std::uint64_t, Sent> windows_;  // by id, near the finger
  std::atomic<std::uint64_t> sent_{0}, acknowledged_{0};
};

}  // namespace teletact::service
