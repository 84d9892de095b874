// The contact law as one stream has been told it: columns by place, of the versions that rule there. Checked
// as everything is that comes from the network.
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
  static constexpr std::size_t kMostColumns = 1024;  // those farthest from the finger go first

  // Another stream, on the layer at this depth: nothing is known.
  void open(double layer_depth_m);
  // False for a piece that is malformed, or not the next: nothing that is known changes.
  bool take(const v1::LawPiece& piece, double finger_x_m);
  std::uint64_t pieces() const { return pieces_; }  // that have come on this stream

  // What the servo should have for a finger at x; none when that is what it was given last.
  std::optional<NearLaw> fresh(double x_m);

 private:
  void forget_far_from(double x_m);

  std::map<double, LawColumn> columns_;  // by x
  double layer_depth_m_ = 0;
  std::uint64_t pieces_ = 0;
  bool changed_ = false;
  double given_x_m_ = 0;
};

}  // namespace teletact::client
