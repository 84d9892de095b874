// What an estimator makes of a window of `real-tissue`, beside its truth.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "bench/basics/median.h"
#include "bench/suites/real_tissue/rows.h"

namespace teletact::bench {

inline constexpr double kQuantile = 1.96;

struct Estimator {
  std::string name;
  void (*state)(service::TissueExtent&);  // changes what is stated
  bool promised;                          // what the product is held to; else beside it
};

std::vector<Estimator> estimators();

// Of one window by one estimator.
struct RealWindow {
  std::string row, estimator;
  double contrast_of_lump = 1;
  std::uint64_t seed = 0;
  bool refused = false;
  double background = kNan;  // over truth: the median where the truth is background
  double contrast = kNan;    // over truth: median inside over median of the background
  double ramp = kNan;        // background's lower third over its upper third
  double coverage = kNan;    // share of nodes whose truth is within 1.96 of what they state
  double lump_error = kNan, lump_deviation = kNan;              // ln of the mean modulus inside, and stated
  double background_error = kNan, background_deviation = kNan;  // the same beside it
  double deviation = kNan;                                      // median stated
  double off = kNan;                                            // 95 % of the nodes are off by less, |ln|
  double skin_held = kNan;   // share of the nodes at the face, above all others, as `coverage`
  double tracking_m = kNan;  // median error of the axial displacement
  double seconds = kNan, processor_s = kNan, modulus_s = kNan;  // of the estimate; processor: all threads
  double truth_s = kNan;                                        // until the solid was solved
  std::vector<std::string> said;                                // warnings, each once
};

// An estimate that fails is said, and refused.
RealWindow estimated(service::Elastography& elastography, const RealRow& row, std::uint64_t seed,
                     const Window& w, const Estimator& by);

}  // namespace teletact::bench
