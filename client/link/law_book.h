// The contact law as one stream has been told it: lanes of columns by place, of the versions that rule there.
// Checked as everything is that comes from the network.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>

#include "client/render/near_law.h"
#include "teletact/v1/palpation.pb.h"

namespace teletact::client {

class LawBook {
 public:
  static constexpr std::size_t kMaxColumns = 1024;  // those farthest from the finger go first

  // Another stream, on the layer at this depth: nothing is known.
  void open(double layer_depth_m);
  // This stream is another one on the same scene: what `before` knows of the same layer is known here.
  // Versions tell what is newer, and pieces of this stream have its own numbers.
  void go_on_from(const LawBook& before);
  // False for a piece that is malformed, or not the next: nothing that is known changes.
  bool take(const v1::LawPiece& piece, double finger_x_m, double finger_z_m = 0);
  std::uint64_t pieces() const { return pieces_; }  // that have come on this stream

  // What the servo should have for a finger there; none when that is what it was given last. `guesses`: what
  // is not corrected, too, as whoever is so far away needs that his answers are worse than a guess.
  std::optional<NearLaw> fresh(double x_m, double z_m = 0, bool guesses = true);

 private:
  using Lane = std::map<double, LawColumn>;  // by x
  void forget_far_from(double x_m, double z_m);

  std::map<double, Lane> lanes_;  // by z; none is empty
  std::size_t columns_ = 0;
  double layer_depth_m_ = 0;
  std::uint64_t pieces_ = 0;
  bool changed_ = false;
  double given_x_m_ = 0, given_z_m_ = 0;
  bool given_guesses_ = true;
};

}  // namespace teletact::client
