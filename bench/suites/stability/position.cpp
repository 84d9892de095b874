// Displays that command a position: the damping that the virtual coupling's tool needs so that a hand which
// presses tissue comes to rest, found by bisection, against the bound that the client damps by
// (client/haptic/virtual_coupling.h). The tissue is rendered from answers, by the Kalman filter with tangent.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>

#include "bench/curves.h"
#include "bench/stability/renderers.h"
#include "bench/stability/servo_period.h"
#include "bench/stability/tissue.h"
#include "bench/stability/trial.h"
#include "bench/suites/stability/stability.h"
#include "client/haptic/simulated_position_device.h"

namespace teletact::bench {
namespace {

using client::ForceSample;

// The first is worse than any (T5.7): light, stiff, and dissipates nothing.
const std::vector<HandProfile> kHands{{"without damping", 0.01, 0, 1000},
                                      hand("light, loose, soft"),
                                      hand("light, loose, stiff"),
                                      hand("heavy, loose, stiff")};

struct Press {
  HandProfile hand;
  double stiffness_n_m = 800, update_s = 0.001, model_delay_s = 0, damping_share = 1;
};

client::SimulatedPositionDevice make_display(const Press& press) {
  client::SimulatedPositionDeviceOptions options;
  options.profile = client::device_profile("premium-1.5");
  options.profile.largest_stiffness_n_m = press.stiffness_n_m;
  options.profile.largest_force_n = 1e3;  // the coupling alone is asked
  options.hand.mass_kg = press.hand.mass_kg;
  options.hand.damping_n_s_m = press.hand.damping_n_s_m;
  options.hand.stiffness_n_m = press.hand.stiffness_n_m;
  options.hand.begin_m = options.hand.end_m = options.hand.start_m = 0.05;
  options.hand.depth_gain_1_s = 0;
  options.damping_share = press.damping_share;
  return client::SimulatedPositionDevice(options);
}

// Swing of the arm in the sixth second no larger than in the third, or too small to feel.
bool comes_to_rest(const Press& press) {
  constexpr double kUnfeltM = 1e-6;
  client::SimulatedPositionDevice display = make_display(press);
  display.open();
  const StabilityTissue tissue(Scene::kHomogeneous, press.stiffness_n_m);
  const auto renderer = make_any_renderer("kalman", kServoS);
  std::deque<ForceSample> on_the_way;
  double low_m[6], high_m[6], next_s = 0;
  std::fill_n(low_m, 6, INFINITY);
  std::fill_n(high_m, 6, -INFINITY);
  for (int tick = 0; tick < 6000; ++tick) {
    const double time_s = kServoS * tick;
    client::DeviceReading reading;
    display.read(tick * kServoNs, reading);
    if (time_s >= next_s) {
      on_the_way.push_back(tissue.told(reading.pose.position_m));
      on_the_way.back().pose_time_s = time_s;
      next_s += press.update_s;
    }
    for (; !on_the_way.empty() && on_the_way.front().pose_time_s + press.model_delay_s <= time_s;
         on_the_way.pop_front())
      renderer->update(on_the_way.front(), reading.pose, time_s);
    display.write(renderer->render(reading.pose, time_s).force_n);
    display.show({.force_on = true, .link_alive = true, .covered = true, .region = {.end_x_m = 0.1}});
    const double y_m = display.arm().position_m.y();
    if (!(std::abs(y_m) < 1)) return false;
    low_m[tick / 1000] = std::min(low_m[tick / 1000], y_m);
    high_m[tick / 1000] = std::max(high_m[tick / 1000], y_m);
  }
  const double later_m = high_m[5] - low_m[5];
  return later_m < kUnfeltM || later_m < high_m[2] - low_m[2];
}

// Of the bound: the least damping with which it comes to rest.
double border_share(Press press) {
  double low = 0.01, high = 2;
  const auto rests = [&](double share) {
    press.damping_share = share;
    return comes_to_rest(press);
  };
  if (rests(low)) return low;
  while (high / low > 1.01) {
    const double middle = std::sqrt(low * high);
    (rests(middle) ? high : low) = middle;
  }
  return high;
}

struct Row {
  std::string hand;
  double stiffness_n_m = 0, update_s = 0, model_delay_s = 0, border_n_s_m = 0, bound_n_s_m = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Row, hand, stiffness_n_m, update_s, model_delay_s, border_n_s_m,
                                   bound_n_s_m)
struct Figures {
  std::vector<Row> rows;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, rows)

Figures measure(bool quick, Promises& promises) {
  const std::vector<double> stiffnesses =
      quick ? std::vector<double>{800} : std::vector<double>{100, 200, 400, 800, 1600};
  Figures figures;
  double worst = 0;
  std::printf(
      "\nposition display: damping that is needed over the bound, most over tissue of %.0f to %.0f N/m\n",
      stiffnesses.front(), stiffnesses.back());
  for (const HandProfile& hand : kHands) {
    double most = 0;
    for (const double update_s : {0.001, 0.02})
      for (const double delay_s : {0.0, 0.05})
        for (const double stiffness_n_m : stiffnesses) {
          const double share = border_share({hand, stiffness_n_m, update_s, delay_s});
          most = std::max(most, share);
          const double bound_n_s_m = client::coupling_damping_n_s_m(stiffness_n_m, kServoS);
          figures.rows.push_back(
              {hand.name, stiffness_n_m, update_s, delay_s, share * bound_n_s_m, bound_n_s_m});
        }
    std::printf("  %.3f  %s\n", most, hand.name);
    worst = std::max(worst, most);
  }
  promises.push_back({"position_display_damping_needed_over_the_couplings", worst, 1});
  return figures;
}

void draw(const Figures& figures, const std::filesystem::path& folder) {
  std::vector<Curve> curves;
  for (const Row& row : figures.rows) {
    const std::string title = "hand: " + row.hand;
    if (curves.empty() || curves.back().title != title) curves.push_back({.title = title, .line = false});
    curves.back().add(row.stiffness_n_m, row.border_n_s_m);
  }
  const double at_rest = client::coupling_damping_n_s_m(0, kServoS),
               more = client::coupling_damping_n_s_m(1, kServoS) - at_rest;
  plot(folder / "stability_position.png",
       script_of(curves,
                 "set logscale xy\nset key bottom right\n" +
                     axes("A display that commands a position: damping of the virtual tool", "tissue (N/m)",
                          "damping (N s/m)"),
                 fmt::format(", {} + {} * x with lines lw 2 lc rgb 'black' title 'the coupling damps by'",
                             at_rest, more)));
}

}  // namespace

Part stability_position() {
  return make_part("position", measure, draw);
}

}  // namespace teletact::bench
