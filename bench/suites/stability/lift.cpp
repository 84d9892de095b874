// Presses as deep as each device's largest force, lifts at up to 0.5 m/s and taps at 3 Hz, by every renderer,
// on tissue within the device's stiffness cap: no force in the air, no more energy back than was put in but
// for what a force held between ticks gives (K T/2), and DEGRADED nowhere.
#include <cstdio>
#include <map>

#include "bench/stability/lift.h"
#include "bench/stability/renderers.h"
#include "bench/suites/stability/lift_tally.h"
#include "bench/suites/stability/stability.h"
#include "client/patient/parallel.h"

namespace teletact::bench {

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(LiftResult, in_air_n, largest_n, stored_j, given_j, over_allowed,
                                   degraded_share, damping_share, enabled_share)

namespace {

// A harder model is given as the mechanism's damping pays for it (T5.4b), which is left out here.
constexpr double kOverAllowed = 1.1;

struct Rate {
  double update_s, model_delay_s;
};

std::vector<client::DeviceProfile> devices() {
  std::vector<client::DeviceProfile> all = client::device_profiles();
  all.push_back({"states nothing", 4, 400, 4, 0.1, 0.05, 0, 0, 0});
  return all;
}

std::vector<LiftOptions> trials(bool quick) {
  const std::vector<Rate> rates = quick ? std::vector<Rate>{{0.002, 0.003}}
                                        : std::vector<Rate>{{0.001, 0.001}, {0.002, 0.003}, {0.005, 0.005},
                                                            {0.01, 0.01},   {0.02, 0.02},   {0.05, 0.05}};
  const std::vector<double> speeds = quick ? std::vector<double>{0.5} : std::vector<double>{0.05, 0.3, 0.5};
  std::vector<const HandProfile*> movers{nullptr, &hand("middle")};
  if (!quick) movers.push_back(&hand("heavy, damped, stiff"));
  std::vector<LiftOptions> all;
  LiftOptions t;
  for (const client::DeviceProfile& device : devices())
    for (const std::string& renderer : renderer_names())
      for (const Scene scene : {Scene::kHomogeneous, Scene::kInclusions})
        for (const double share : {0.5, 1.0})
          for (const Rate& rate : rates)
            for (const bool known : {true, false})
              for (const HandProfile* mover : movers) {
                t.device = device, t.renderer = renderer, t.scene = scene, t.hand = mover,
                t.damping_known = known;
                t.stiffness_n_m = share * device.largest_stiffness_n_m;
                t.update_s = rate.update_s, t.model_delay_s = rate.model_delay_s;
                t.motion = LiftMotion::kTap;
                all.push_back(t);
                t.motion = LiftMotion::kLift;
                for (const double speed : speeds) t.lift_m_s = speed, all.push_back(t);
              }
  return all;
}

// A model that is honest: of the tissue below the finger. On the flank of an inclusion a hand slides: there
// it needs its gradients. A force that is held as it is gives energy (T5.2), and is said to.
bool honest(const LiftOptions& t) {
  if (t.renderer != "kalman" && t.renderer != "kalman-force") return false;
  const bool slides = t.hand != nullptr && t.scene == Scene::kInclusions;
  return !slides || t.renderer == "kalman";
}

struct Row {
  std::string device, renderer, scene;
  double stiffness_n_m = 0, update_s = 0, model_delay_s = 0;
  bool damping_known = false;
  std::string hand, motion;
  double lift_m_s = 0;
  bool honest = false;
  LiftResult result{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Row, device, renderer, scene, stiffness_n_m, update_s, model_delay_s,
                                   damping_known, hand, motion, lift_m_s, honest, result)
struct Figures {
  std::vector<Row> rows;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, rows)

Figures measure(bool quick, Promises& promises) {
  const std::vector<LiftOptions> all = trials(quick);
  std::vector<LiftResult> results(all.size());
  client::in_parallel(all.size(), [&](std::size_t n) { results[n] = run_lift(all[n]); });
  LiftTally all_of_them, honest_ones;
  std::map<std::string, LiftTally> by_renderer;
  Figures figures;
  for (std::size_t n = 0; n < all.size(); ++n) {
    const LiftOptions& t = all[n];
    const LiftResult& r = results[n];
    all_of_them.add(t, r);
    if (honest(t)) honest_ones.add(t, r);
    by_renderer[t.renderer + (honest(t) || t.renderer.rfind("kalman", 0) != 0 ? "" : ", sliding")].add(t, r);
    figures.rows.push_back({t.device.name, t.renderer, to_string(t.scene), t.stiffness_n_m, t.update_s,
                            t.model_delay_s, t.damping_known, t.hand == nullptr ? "none" : t.hand->name,
                            t.motion == LiftMotion::kTap ? "tap" : "lift", t.lift_m_s, honest(t), r});
  }
  std::printf("\npresses to the largest force, lifted at up to 0.5 m/s and tapped at 3 Hz\n");
  for (const auto& [name, t] : by_renderer)
    std::printf(
        "  %s: of %zu a force in the air %zu (most %.2f N), given back beyond what was put in %.2f mJ, %.2f "
        "of K T/2; DEGRADED %zu, damped %zu, not ENABLED throughout %zu\n",
        name.c_str(), t.trials, t.in_air, t.in_air_n, 1e3 * t.given_j, t.over_allowed, t.degraded, t.damped,
        t.not_enabled);
  promises.push_back({"lifts_and_taps_largest_force_in_the_air", all_of_them.in_air_n, 0, "N"});
  promises.push_back({"lifts_and_taps_by_a_model_most_given_back_beyond_what_was_put_in",
                      honest_ones.over_allowed, kOverAllowed, "of K T/2"});
  promises.push_back({"lifts_and_taps_by_a_model_degraded", double(honest_ones.degraded), 0, "trials"});
  promises.push_back(
      {"lifts_and_taps_by_a_model_not_enabled_throughout", double(honest_ones.not_enabled), 0, "trials"});
  promises.push_back(
      {"lifts_and_taps_force_reached_over_the_largest", honest_ones.max_force, 0.999, "", false});
  return figures;
}

}  // namespace

Part stability_lift() {
  return make_part("lift", measure);
}

}  // namespace teletact::bench
