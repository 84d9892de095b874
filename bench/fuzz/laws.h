// Contact laws on their way from a service to a servo, some of them hostile: pieces that are malformed, of no
// numbers, of other versions or out of order, that say what no tissue is, and whole laws that are wrong.
#pragma once

#include <deque>
#include <optional>

#include "bench/fuzz/fuzz.h"
#include "bench/fuzz/source.h"
#include "bench/stability/tissue.h"
#include "client/link/law_book.h"

namespace teletact::bench {

class FuzzLaws {
 public:
  // Of the pieces `hostile` are, and of the laws as many are another tissue's.
  FuzzLaws(Source& source, double hostile);
  // What the servo is told at this tick, if anything. A new version's pieces come within some ticks.
  std::optional<client::NearLaw> next(const StabilityTissue& tissue, std::uint64_t version, double finger_x_m,
                                      FuzzShares& shares);

 private:
  void tell(const StabilityTissue& tissue, std::uint64_t version);
  void spoil(v1::LawPiece& piece);

  Source& source_;
  double hostile_;
  bool across_ = false;  // told as a solid's, in two lanes: of this stream
  client::LawBook book_;
  std::deque<v1::LawPiece> waiting_;
  std::uint64_t told_version_ = 0, piece_ = 0;
};

}  // namespace teletact::bench
