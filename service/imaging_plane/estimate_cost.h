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
#include <string>

#include "service/base/choices.h"
#include "service/imaging/modulus/modulus_plan.h"

namespace teletact::service {

struct EstimateSize {
  std::size_t samples = 0, lines = 0;
  double max_strain = choices::kMaxStrain;
  double window_width_m = 0, depth_m = 0;
  ModulusKind method = ModulusKind::kIterative;
  double modulus_time_limit_s = HUGE_VAL;  // counted at what a usual core takes (usual_modulus)
  bool published = false;
};

// About the most that an idle core of 2024 takes. A limit of time is counted at these, so that it leaves the
// same on every machine.
ModulusCost usual_modulus(const EstimateSize&);

struct EstimateSeconds {
  double tracking = 0, modulus = 0, publishing = 0;
  double start = 0;  // by the direct method, where the iterative one began with it: part of the modulus's
  int steps = 0;     // of the iterative method after that; solves of a solid
};

class EstimateCost {
 public:
  using Time = std::chrono::steady_clock::time_point;
  static constexpr double kHalfLifeS = 300;        // of what was measured, while nothing is
  static constexpr double kMinShare = 0.5;         // of it, that is always expected
  static constexpr double kMinShareRefused = 0.1;  // the same, once estimates were refused for long

  EstimateCost();

  double expected_s(const EstimateSize&, Time now = std::chrono::steady_clock::now()) const;
  // With the quickest modulus that may answer it; `planned`: by reference stress, too.
  double min_s(const EstimateSize&, bool planned, Time now = std::chrono::steady_clock::now()) const;
  // What there is time for, by what was measured, however long ago; but that it begins at all is tried again.
  ModulusBudget budget(const EstimateSize&, double left_s, const std::string& why,
                       Time now = std::chrono::steady_clock::now()) const;
  double expected_publishing_s(const EstimateSize&, Time now = std::chrono::steady_clock::now()) const;
  // One was refused that had `left_s` seconds. What could not even by itself be done in the least that is
  // ever expected says nothing of what is expected, and does not count.
  void refused(const EstimateSize&, double left_s, Time now = std::chrono::steady_clock::now());
  // One was tried and was not done in its time, after so much work: what was measured holds again, and an
  // estimate takes as much at least.
  void late(const EstimateSize&, double worked_s, Time now = std::chrono::steady_clock::now());
  // The parts that were done; 0: was not, though it was tried.
  void took(const EstimateSize&, const EstimateSeconds&, Time now = std::chrono::steady_clock::now());

 private:
  struct Rate {
    double s_per_work = 0;
    bool measured = false;
    void learn(double seconds, double work);
  };
  double measured_s(const EstimateSize&) const;  // under the lock, as below
  double modulus_s(const EstimateSize&) const;
  double beside_modulus_s(const EstimateSize&) const;
  ModulusCost modulus_cost(const EstimateSize&, double share) const;
  double publishing_s(const EstimateSize&) const;
  Rate& rate(ModulusKind kind) { return modulus_[static_cast<std::size_t>(kind)]; }
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
  std::array<Rate, 4> modulus_;     // by ModulusKind
  double steps_ = 5, solves_ = 25;  // that an estimate takes
};

}  // namespace teletact::service
