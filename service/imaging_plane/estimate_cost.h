// How long an estimate will work, by what the ones before took: seconds per work of each of its parts, where
// work is what the operations grow with. Good to a factor of two for sizes not seen yet, to some 20 % for
// those that come again and again. What was measured in a busy minute is not believed for ever: the longer
// nothing was measured the less is expected, down to half of it. While estimates go on being refused,
// whoever's, less and less still, down to a tenth, or what was refused would never be tried again; a pause
// between two counts as a half-life at most, and an estimate that is done or late ends that. Thread-safe.
#pragma once

#include <array>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <mutex>
#include <optional>

#include "service/base/choices.h"
#include "service/imaging/modulus/modulus.h"

namespace teletact::service {

struct EstimateSize {
  std::size_t samples = 0, lines = 0;
  double max_strain = choices::kMaxStrain;
  double window_width_m = 0, depth_m = 0;
  ModulusKind method = ModulusKind::kIterative;
  double modulus_time_limit_s = HUGE_VAL;  // of the iterative method
  bool published = false;
};

struct EstimateSeconds {
  double tracking = 0, modulus = 0, publishing = 0;
  double start = 0;  // by the direct method, where the iterative one began with it: part of the modulus's
};

class EstimateCost {
 public:
  using Time = std::chrono::steady_clock::time_point;
  static constexpr double kHalfLifeS = 300;        // of what was measured, while nothing is
  static constexpr double kMinShare = 0.5;         // of it, that is always expected
  static constexpr double kMinShareRefused = 0.1;  // the same, once estimates were refused for long

  double expected_s(const EstimateSize&, Time now = std::chrono::steady_clock::now()) const;
  // The same of its parts: of the modulus by each method (by ModulusKind), and of what is published.
  std::array<double, 4> expected_modulus_s(const EstimateSize&,
                                           Time now = std::chrono::steady_clock::now()) const;
  double expected_publishing_s(const EstimateSize&, Time now = std::chrono::steady_clock::now()) const;
  // One was refused that had `left_s` seconds. What could not even by itself be done in the least that is
  // ever expected says nothing of what is expected, and does not count.
  void refused(const EstimateSize&, double left_s, Time now = std::chrono::steady_clock::now());
  // One was tried and was not done in its time: what was measured holds again.
  void late(Time now = std::chrono::steady_clock::now());
  // The parts that were done; 0: was not, though it was tried.
  void took(const EstimateSize&, const EstimateSeconds&, Time now = std::chrono::steady_clock::now());

 private:
  struct Rate {
    double s_per_work;
    bool measured = false;
    void learn(double seconds, double work);
  };
  double measured_s(const EstimateSize&) const;  // under the lock, as below
  double modulus_s(const EstimateSize&, ModulusKind) const;
  double publishing_s(const EstimateSize&) const;
  void learn_modulus(ModulusKind, double seconds, double work);
  double believed(Time now) const;  // share of what was measured
  mutable std::mutex mutex_;
  Time measured_ = std::chrono::steady_clock::now();
  struct Refusals {
    Time last;
    double lasted_s = 0;  // from the first to the last
  };
  std::optional<Refusals> refused_;  // since then
  // Those of a slow core, until something was measured.
  Rate tracking_{6e-7}, publishing_{1e-10};
  std::array<Rate, 4> modulus_{{{1e-9}, {3.6e-10}, {1e-9}, {2e-9}}};  // by ModulusKind
};

}  // namespace teletact::service
