// The tissue's contact law in place of answers, through the whole servo loop: every display with its caps
// reached on inclusions and left sideways, every hand (T5.7), 20 answers a second that are up to 300 ms late,
// or do not come for 200 ms in a tenth of the time; presses, slides, taps and lifts; laws that change, end
// and come under the finger.
#include <algorithm>
#include <cstdio>
#include <map>

#include "bench/stability/lift.h"
#include "bench/stability/servo_period.h"
#include "bench/stability/trial.h"
#include "bench/suites/stability/lift_tally.h"
#include "bench/suites/stability/stability.h"
#include "client/patient/parallel.h"

namespace teletact::bench {
namespace {

using client::DeviceProfile;

constexpr double kAnswersS = 0.05;
constexpr double kStallS = 0.2, kStallLateS = 0.1;  // with stalls, answers are no later than that
constexpr double kUntoldM = 0.05;                   // of it and beyond the law says nothing
constexpr double kOfServoBound = 0.9;
constexpr double kHalfMin = 0.95, kOneMin = 0.99;  // of the ticks
constexpr double kGivenMax = 0.01;                 // of what was held: what a law is off by
constexpr double kRoundingJ = 1e-12;
constexpr double kOverAllowed = 1.1;  // as lift.cpp's

std::vector<TrialOptions> trials(bool quick) {
  std::vector<TrialOptions> all;
  TrialOptions t;
  t.renderer = "law";
  t.safe = true;
  t.update_s = kAnswersS;
  t.indentation_m = 0.002;
  t.rest_s = 2;
  std::vector<DeviceProfile> devices = client::device_profiles();
  devices.push_back(ideal_display());
  const std::vector<double> dampings =
      quick ? std::vector<double>{0.005, 0.5, 5} : std::vector<double>{0.005, 0.016, 0.05, 0.16, 0.5, 1.6, 5};
  for (const DeviceProfile& device : devices)
    for (const HandProfile& hand : quick ? std::vector{hands().front()} : hands())
      for (const Scene scene : {Scene::kHomogeneous, Scene::kInclusions})
        for (const double damping : dampings)
          for (const double stiffness : {kLawWithinCap, 1.5})
            for (const double stall_s : {0.0, kStallS})
              for (const double delay_s : {0.0, 0.05, 0.1, 0.2, 0.3})
                for (const double end_m : {TrialOptions().law_end_m, kUntoldM}) {
                  const bool ideal = device.name == ideal_display().name;
                  if (stall_s > 0 && delay_s > kStallLateS) continue;
                  if (ideal && stiffness > 1) continue;
                  t.device = device, t.hand = hand, t.scene = scene, t.damping_n_s_m = damping;
                  t.stiffness_n_m = ideal ? kOfServoBound * 2 * damping / kServoS
                                          : stiffness * device.largest_stiffness_n_m;
                  t.model_delay_s = delay_s, t.stall_s = stall_s, t.law_end_m = end_m;
                  all.push_back(t);
                }
  return all;
}

std::vector<LiftOptions> lifts(bool quick) {
  std::vector<LiftOptions> all;
  LiftOptions t;
  t.renderer = "law";
  t.update_s = kAnswersS;
  std::vector<DeviceProfile> devices = client::device_profiles();
  devices.push_back({"states nothing", 4, 400, 4, 0.1, 0.05, 0, 0, 0});
  std::vector<const HandProfile*> movers{nullptr, &hand("middle")};
  if (!quick) movers.push_back(&hand("heavy, damped, stiff"));
  for (const DeviceProfile& device : devices)
    for (const Scene scene : {Scene::kHomogeneous, Scene::kInclusions})
      for (const double share : {0.5, 1.5})
        for (const double delay_s : quick ? std::vector{0.1} : std::vector{0.0, 0.1, 0.3})
          for (const bool known : {true, false})
            for (const HandProfile* mover : movers)
              for (const LawTold law : {LawTold::kOne, LawTold::kChanging, LawTold::kComingAndGoing})
                for (const double stall_s : {0.0, kStallS, 2 * kStallS})
                  for (const LiftMotion motion : {LiftMotion::kLift, LiftMotion::kTap, LiftMotion::kSlide}) {
                    t.device = device, t.scene = scene, t.damping_known = known, t.hand = mover;
                    t.stiffness_n_m = share * device.largest_stiffness_n_m;
                    t.model_delay_s = delay_s, t.law = law, t.stall_s = stall_s, t.motion = motion;
                    all.push_back(t);
                  }
  return all;
}

struct Tally {
  std::size_t trials = 0, not_stable = 0, degraded = 0, generated = 0;
  double half = 1, one = 1, given = 0, fast = 0, min_ledger_j = 0;
  void add(const TrialResult& r) {
    ++trials;
    not_stable += r.verdict != Verdict::kStable;
    degraded += r.degraded_share > 0;
    generated += r.generated_j > kGivenMax * r.stored_j;
    half = std::min(half, r.within_half);
    one = std::min(one, r.within_one);
    given = std::max(given, r.given);
    fast = std::max(fast, r.fast_share);
    min_ledger_j = std::min(min_ledger_j, r.min_ledger_j);
  }
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Tally, trials, not_stable, degraded, generated, half, one, given, fast,
                                   min_ledger_j)

struct Figures {
  std::map<std::string, Tally> trials;
  std::map<std::string, LiftTally> lifts;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, trials, lifts)

const char* to_string(LawTold law) {
  return law == LawTold::kOne ? "one law" : law == LawTold::kChanging ? "changing" : "coming and going";
}

void measure_trials(bool quick, Figures& figures, Promises& promises) {
  const std::vector<TrialOptions> all = trials(quick);
  std::vector<TrialResult> results(all.size());
  client::in_parallel(all.size(), [&](std::size_t n) { results[n] = run_trial(all[n]); });
  Tally told;
  double min_ledger_j = 0;
  for (std::size_t n = 0; n < all.size(); ++n) {
    const TrialOptions& t = all[n];
    const bool untold = t.law_end_m == kUntoldM;
    min_ledger_j = std::min(min_ledger_j, results[n].min_ledger_j);
    if (!untold) told.add(results[n]);
    const std::string capped = t.stiffness_n_m > t.device.largest_stiffness_n_m ? ", past the cap" : "";
    figures.trials[(untold          ? "half of the law known"
                    : t.stall_s > 0 ? "stalls"
                                    : "no stalls") +
                   capped]
        .add(results[n]);
  }
  std::printf("\nby the contact law, 20 answers a second up to 300 ms late\n");
  for (const auto& [name, t] : figures.trials)
    std::printf(
        "  %s: of %zu not stable %zu, active %zu, DEGRADED %zu; least share of ticks within 0.5 %% + 1 mN "
        "%.4f, 1 %% + 1 mN %.4f; given %.4f of what was held; most ticks past 150 mm/s %.3f\n",
        name.c_str(), t.trials, t.not_stable, t.generated, t.degraded, t.half, t.one, t.given, t.fast);
  promises.push_back({"law_trials_not_stable", double(told.not_stable), 0, "trials"});
  promises.push_back({"law_trials_that_generate_energy", double(told.generated), 0, "trials"});
  promises.push_back({"law_given_beyond_k_t_half_over_what_was_held", told.given, kGivenMax});
  promises.push_back({"law_least_share_of_ticks_within_half_a_percent", told.half, kHalfMin, "", false});
  promises.push_back({"law_least_share_of_ticks_within_a_percent", told.one, kOneMin, "", false});
  promises.push_back({"law_trials_degraded", double(told.degraded), 0, "trials"});
  promises.push_back({"law_least_left_in_a_ledger", min_ledger_j, -kRoundingJ, "J", false});
}

void measure_lifts(bool quick, Figures& figures, Promises& promises) {
  const std::vector<LiftOptions> all = lifts(quick);
  std::vector<LiftResult> results(all.size());
  client::in_parallel(all.size(), [&](std::size_t n) { results[n] = run_lift(all[n]); });
  LiftTally steady, everywhere;
  for (std::size_t n = 0; n < all.size(); ++n) {
    const LiftOptions& t = all[n];
    everywhere.add(t, results[n]);
    if (t.law == LawTold::kOne && t.stall_s <= kStallS) steady.add(t, results[n]);
    const std::string stalls = t.stall_s > kStallS ? ", long stalls" : t.stall_s > 0 ? ", stalls" : "";
    figures.lifts[to_string(t.law) + stalls].add(t, results[n]);
  }
  std::printf("by the contact law, presses to the largest force, slides, taps and lifts\n");
  for (const auto& [name, t] : figures.lifts)
    std::printf(
        "  %s: of %zu a force in the air %zu, given back beyond what was put in %.2f mJ, %.2f of K T/2, with "
        "what is stated to dissipate %.2f; DEGRADED %zu, not ENABLED throughout %zu\n",
        name.c_str(), t.trials, t.in_air, 1e3 * t.given_j, t.over_allowed, t.over_paid, t.degraded,
        t.not_enabled);
  promises.push_back({"law_lifts_with_a_force_in_the_air", double(everywhere.in_air), 0, "trials"});
  promises.push_back(
      {"law_lifts_most_given_back_beyond_what_was_put_in", steady.over_allowed, kOverAllowed, "of K T/2"});
  promises.push_back({"law_changes_and_long_stalls_most_given_back_beyond_what_was_paid_for",
                      everywhere.over_paid, kOverAllowed, "of K T/2"});
  promises.push_back({"law_lifts_degraded", double(steady.degraded), 0, "trials"});
  promises.push_back({"law_lifts_least_left_in_a_ledger", everywhere.min_ledger_j, -kRoundingJ, "J", false});
  promises.push_back({"law_lifts_force_reached_over_the_largest", everywhere.max_force, 0.9, "", false});
}

Figures measure(bool quick, Promises& promises) {
  Figures figures;
  measure_trials(quick, figures, promises);
  measure_lifts(quick, figures, promises);
  return figures;
}

}  // namespace

Part stability_law() {
  return make_part("law", measure);
}

}  // namespace teletact::bench
