// The chart: for each renderer as it is, without the safety chain, the stiffness up to which a display with a
// hand on it is stable, and up to which it does no more than a limit cycle, over update period, delays,
// damping, hand and device; found by bisection on the logarithm of the stiffness. Beside it Colgate's bound
// with delay (T5.2), which is sufficient and not necessary with a hand, and the friction and quantisation
// bound (T5.6).
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <set>

#include "bench/basics/median.h"
#include "bench/curves.h"
#include "bench/stability/passivity_border.h"
#include "bench/stability/renderers.h"
#include "bench/stability/servo_period.h"
#include "bench/stability/trial.h"
#include "bench/suites/stability/stability.h"
#include "client/patient/parallel.h"

namespace teletact::bench {
namespace {

constexpr double kSoftestNM = 1, kHardestNM = 2e4;
constexpr double kSweepM = 0.03, kRestS = 2;
constexpr double kFeltNM = 400;  // where the generated energy is told: a stiff inclusion

const HandProfile& charted_hand(double value) {
  static const char* const kNames[] = {"light, loose, soft", "middle", "heavy, damped, stiff"};
  return hand(kNames[static_cast<std::size_t>(value)]);
}

struct Axis {
  const char* name;
  std::vector<double> values;
  void (*set)(TrialOptions&, double);
};

std::vector<Axis> axes_of(bool quick) {
  std::vector<Axis> all{
      {"force_delay_s",
       {0, 0.001, 0.005, 0.014, 0.05, 0.15, 0.3},
       [](TrialOptions& t, double v) { t.force_delay_s = v; }},
      {"model_delay_s",
       {0, 0.01, 0.03, 0.1, 0.2, 0.3},
       [](TrialOptions& t, double v) { t.model_delay_s = v; }},
      {"damping_n_s_m", {0.005, 0.05, 0.5, 5}, [](TrialOptions& t, double v) { t.damping_n_s_m = v; }},
      {"hand", {0, 1, 2}, [](TrialOptions& t, double v) { t.hand = charted_hand(v); }},
      {"device", {0, 1, 2, 3, 4}, [](TrialOptions& t, double v) {
         const auto k = static_cast<std::size_t>(v);
         t.device = k < client::device_profiles().size() ? client::device_profiles()[k] : ideal_display();
       }}};
  if (quick)
    for (Axis& axis : all) axis.values.resize(2);
  return all;
}

std::vector<double> periods_s(bool quick) {
  return quick ? std::vector<double>{0.001, 0.02, 0.2}
               : std::vector<double>{0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5};
}

TrialOptions base() {
  TrialOptions t;
  t.device = client::device_profile("premium-1.5");
  t.sweep_m = kSweepM;
  t.rest_s = kRestS;
  return t;
}

// The largest stiffness whose verdict is no worse than `allowed`; the limits of the search where all or none
// is.
double border_n_m(TrialOptions t, Verdict allowed) {
  const auto good = [&](double stiffness_n_m) {
    t.stiffness_n_m = stiffness_n_m;
    return run_trial(t).verdict <= allowed;
  };
  double low = std::log(kSoftestNM), high = std::log(kHardestNM);
  if (!good(kSoftestNM)) return kSoftestNM;
  if (good(kHardestNM)) return kHardestNM;
  constexpr double kWithin = 0.02;
  while (high - low > kWithin) {
    const double middle = (low + high) / 2;
    (good(std::exp(middle)) ? low : high) = middle;
  }
  return std::exp(low);
}

struct Row {
  std::string axis;
  double value = 0;
  std::string renderer;
  double update_s = 0, stable_n_m = 0, bounded_n_m = 0, colgate_n_m = 0;
  double quantisation_n_m = 0;  // NaN for a display without resolution
  std::string verdict_at_400_n_m{};
  double generated_j_at_400_n_m = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Row, axis, value, renderer, update_s, stable_n_m, bounded_n_m, colgate_n_m,
                                   quantisation_n_m, verdict_at_400_n_m, generated_j_at_400_n_m)
struct Figures {
  std::string device = base().device.name;
  double damping_n_s_m = base().damping_n_s_m;
  std::vector<Row> rows{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, device, damping_n_s_m, rows)

Row chart(const TrialOptions& at, const Axis& axis, double value) {
  TrialOptions t = at;
  const double stable = border_n_m(t, Verdict::kStable);
  const double bounded = std::max(border_n_m(t, Verdict::kLimitCycle), stable);
  t.stiffness_n_m = kFeltNM;
  const TrialResult felt = run_trial(t);
  // A held force: sampled every update, late by both delays. A local model: sampled every servo period.
  const bool local = t.renderer.rfind("kalman", 0) == 0;
  const double period_s = local ? kServoS : t.update_s;
  const double delay_s = t.force_delay_s + (local ? 0 : t.model_delay_s);
  const double colgate = t.damping_n_s_m / colgate_border_n_s_m(1, period_s, delay_s);
  const double quantisation =
      t.device.resolution_m > 0
          ? std::min(2 * t.damping_n_s_m / period_s, 2 * t.device.friction_n / t.device.resolution_m)
          : kNan;
  return {axis.name,       value,        t.renderer,
          t.update_s,      stable,       bounded,
          colgate,         quantisation, to_string(felt.verdict),
          felt.generated_j};
}

Figures measure(bool quick, Promises& promises) {
  struct Point {
    TrialOptions trial;
    const Axis* axis;
    double value;
  };
  const std::vector<Axis> all_axes = axes_of(quick);
  std::vector<Point> points;
  for (const Axis& axis : all_axes)
    for (const double value : axis.values)
      for (const std::string& renderer : renderer_names())
        for (const double update_s : periods_s(quick)) {
          points.push_back({base(), &axis, value});
          points.back().trial.renderer = renderer;
          points.back().trial.update_s = update_s;
          axis.set(points.back().trial, value);
        }
  Figures figures;
  std::vector<Row>& rows = figures.rows;
  rows.resize(points.size());
  client::in_parallel(points.size(), [&](std::size_t n) {
    rows[n] = chart(points[n].trial, *points[n].axis, points[n].value);
  });
  // Colgate's bound is sufficient: a held force inside of it may not shake.
  const auto passive_unstable = std::count_if(rows.begin(), rows.end(), [](const Row& row) {
    return row.renderer == "hold" && row.stable_n_m < row.colgate_n_m;
  });
  std::printf("\nborders of stability at %s, 0.5 N s/m, no delays: update (ms), then N/m by renderer\n",
              figures.device.c_str());
  for (const double update_s : periods_s(quick)) {
    std::printf("  %5.0f", 1e3 * update_s);
    for (const Row& row : rows)
      if (row.axis == "force_delay_s" && row.value == 0 && row.update_s == update_s)
        std::printf("  %s %.0f", row.renderer.c_str(), row.stable_n_m);
    std::printf("\n");
  }
  promises.push_back(
      {"points_where_hold_is_not_stable_inside_colgates_bound", double(passive_unstable), 0, "points"});
  return figures;
}

std::string value_name(const std::string& axis, double value) {
  if (axis == "hand") return std::string("hand: ") + charted_hand(value).name;
  if (axis == "device") {
    const auto k = static_cast<std::size_t>(value);
    return k < client::device_profiles().size() ? client::device_profiles()[k].name : "ideal";
  }
  if (axis == "damping_n_s_m") return fmt::format("{} N s/m", value);
  return fmt::format("{:.0f} ms", 1e3 * value);
}

// One picture per axis: rows of values, columns of renderers; green stable, yellow limit cycle, red unstable.
void draw_axis(const Figures& figures, const std::string& axis, const std::vector<double>& values,
               const std::filesystem::path& file) {
  const auto& names = renderer_names();
  std::string script = fmt::format(
      "set terminal pngcairo size 1400,{}  font 'sans,9'\nset output '{}'\nset multiplot layout {},{} title "
      "'stable (green), limit cycle (yellow), unstable (red); black: Colgate with delay, blue: friction and "
      "quantisation'\nset logscale xy\nset xrange [1:500]\nset yrange [{}:{}]\nunset key\n",
      260 * values.size() + 40, file.string(), values.size(), names.size(), kSoftestNM, kHardestNM);
  for (const double value : values)
    for (const std::string& renderer : names) {
      script += "$region << EOD\n";
      for (const Row& row : figures.rows)
        if (row.axis == axis && row.value == value && row.renderer == renderer)
          script += fmt::format("{} {} {} {} {}\n", 1e3 * row.update_s, row.stable_n_m, row.bounded_n_m,
                                row.colgate_n_m, row.quantisation_n_m);
      script += "EOD\n" + axes(renderer + ", " + value_name(axis, value), "update (ms)", "stiffness (N/m)") +
                fmt::format(
                    "plot $region using 1:({0}):({1}) with filledcurves fc rgb '#f4b6b0', "
                    "$region using 1:({0}):3 with filledcurves fc rgb '#f7e6a1', "
                    "$region using 1:({0}):2 with filledcurves fc rgb '#b7dfb4', "
                    "$region using 1:4 with lines lw 2 lc rgb 'black', "
                    "$region using 1:5 with lines lw 2 dt 2 lc rgb '#3050c0'\n",
                    kSoftestNM, kHardestNM);
    }
  plot(file, script + "unset multiplot\n");
}

void draw(const Figures& figures, const std::filesystem::path& folder) {
  std::map<std::string, std::set<double>> charted;
  for (const Row& row : figures.rows) charted[row.axis].insert(row.value);
  for (const auto& [axis, values] : charted)
    draw_axis(figures, axis, {values.begin(), values.end()}, folder / fmt::format("stability_{}.png", axis));
}

}  // namespace

Part stability_chart() {
  return make_part("chart", measure, draw);
}

}  // namespace teletact::bench
