// The paper's Fig. 14 (T6.1): stiffness as the Kalman filter estimates it, against the real one, while the
// indented node moves from one side of the model to the other and back at 120 mm/s.
//
// Answers come from the service's own contact at the stated rate, are felt one servo period after their pose,
// and the renderer is asked at every servo period. Beside the renderers stand two bounds: the exact expansion
// of the newest answer (no noise, no blending), and the best linear filter: the weights of the last four
// answers, for each tick after an answer its own, fitted by least squares to the real stiffness of this very
// run.
#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>

#include "bench/curves.h"
#include "bench/stability/renderers.h"
#include "bench/stability/servo_period.h"
#include "bench/suites/paper/paper.h"
#include "bench/suites/paper/tissue.h"
#include "service/contact/contact.h"
#include "service/tissue/tissue_model.h"

namespace teletact::bench {
namespace {

using client::ForceSample;
using client::ToolPose;
using client::Vector3;

constexpr double kSpeedMS = 0.12, kIndentationM = 0.002;
constexpr double kBeginM = 0.006, kEndM = 0.094;  // the footprint stays on the model
constexpr double kRateHz = 100;
constexpr double kPoissonRatio = 0.49;
constexpr double kSettledS = 0.05;  // before, the filters have seen too little
constexpr double kLagS = 0.010;
constexpr std::size_t kAnswersFitted = 4;

struct TouchedLayer {
  const char* name;
  std::size_t row;
  double rms_max;  // promised, of the mean stiffness
};
constexpr std::array<TouchedLayer, 2> kLayers{{{"surface", 0, 0.03}, {"layer 80 mm", 8, 0.10}}};

// One filter on one layer.
struct Filter {
  std::string name;
  double lag_s = 0, rms_error = 0, largest_error = 0;  // errors over the mean stiffness
  std::vector<double> stiffness_n_m;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Filter, name, lag_s, rms_error, largest_error, stiffness_n_m)
struct LayerFigures {
  std::string layer;
  std::vector<double> time_s{}, x_m{}, real_n_m{};
  std::vector<Filter> filters{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(LayerFigures, layer, time_s, x_m, real_n_m, filters)
struct Figures {
  double speed_m_s = kSpeedMS, indentation_m = kIndentationM, rate_hz = kRateHz;
  std::vector<LayerFigures> layers;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, speed_m_s, indentation_m, rate_hz, layers)

struct Series {
  std::vector<ForceSample> truth;  // one per servo period
  std::size_t answer_every = 0;    // servo periods
  double stiffness(std::size_t tick) const { return -truth[tick].force_n.y() / kIndentationM; }
};

// There and back. A touched node's force ripples between the nodes (T4.5b), so its footprint is one spacing
// wide.
Series run_along(const service::TissueModel& model, std::size_t row, double rate_hz) {
  const auto compliance = model.compliance(row);
  const service::Fingertip node{.shape = service::FingertipShape::kNode, .footprint_m = 0.002};
  const double way_m = kEndM - kBeginM;
  const auto ticks = static_cast<std::size_t>(std::floor(2 * way_m / kSpeedMS / kServoS));
  Series series;
  series.answer_every = static_cast<std::size_t>(std::lround(1 / (rate_hz * kServoS)));
  for (std::size_t n = 0; n <= ticks; ++n) {
    const double gone_m = kSpeedMS * kServoS * static_cast<double>(n);
    const double x_m = kBeginM + (gone_m <= way_m ? gone_m : 2 * way_m - gone_m);
    const auto answer = service::solve_contact(model.problem(), row, *compliance, node, {x_m, kIndentationM});
    ForceSample sample;
    sample.sequence = n + 1;
    sample.pose_time_s = kServoS * static_cast<double>(n);
    sample.position_m = Vector3(x_m, kIndentationM, 0);
    sample.force_n = Vector3(answer.force_n.data());
    sample.tangent_n_m = Eigen::Map<const Eigen::Matrix3d>(answer.tangent_n_m.data());  // symmetric
    sample.contact = true;
    series.truth.push_back(sample);
  }
  return series;
}

// The newest answer that a tick knows of: sampled at least one servo period before.
std::size_t newest_answer(const Series& series, std::size_t tick) {
  return (tick - 1) / series.answer_every * series.answer_every;
}

std::vector<double> rendered(const Series& series, const std::string& name) {
  const auto renderer = make_any_renderer(name, kServoS);
  std::vector<double> felt{0};
  for (std::size_t n = 1; n < series.truth.size(); ++n) {
    const ToolPose pose{series.truth[n].position_m, Vector3::Zero()};
    const double time_s = series.truth[n].pose_time_s;
    if ((n - 1) % series.answer_every == 0) renderer->update(series.truth[n - 1], pose, time_s);
    felt.push_back(renderer->render(pose, time_s).stiffness_n_m);
  }
  return felt;
}

// k of the newest answer, moved to where the tool is by its own tangent where that is used.
std::vector<double> expanded(const Series& series, bool tangent) {
  std::vector<double> felt{0};
  for (std::size_t n = 1; n < series.truth.size(); ++n) {
    const ForceSample& answer = series.truth[newest_answer(series, n)];
    const Vector3 moved = tangent
                              ? Vector3(answer.tangent_n_m * (series.truth[n].position_m - answer.position_m))
                              : Vector3(Vector3::Zero());
    felt.push_back(-(answer.force_n + moved).y() / kIndentationM);
  }
  return felt;
}

// The rows of one phase (ticks since the answer), and what they should give.
struct Regression {
  std::vector<std::vector<double>> rows;
  std::vector<std::size_t> ticks;
};

// min over w of sum (k - w . [last answers])^2 for each phase by itself.
std::vector<double> best_linear(const Series& series, bool tangent) {
  std::map<std::size_t, Regression> phases;
  for (std::size_t n = kAnswersFitted * series.answer_every; n < series.truth.size(); ++n) {
    Regression& phase = phases[n % series.answer_every];
    std::vector<double> row;
    for (std::size_t back = 0; back < kAnswersFitted; ++back) {
      const std::size_t at = newest_answer(series, n) - back * series.answer_every;
      row.push_back(series.stiffness(at));
      if (tangent)
        row.push_back(
            (series.truth[at].tangent_n_m * (series.truth[n].position_m - series.truth[at].position_m)).y() /
            kIndentationM);
    }
    phase.rows.push_back(row);
    phase.ticks.push_back(n);
  }
  std::vector<double> felt(series.truth.size(), 0);
  for (const auto& [unused, phase] : phases) {
    const auto count = static_cast<Eigen::Index>(phase.rows.size());
    Eigen::MatrixXd a(count, static_cast<Eigen::Index>(phase.rows.front().size()));
    Eigen::VectorXd k(count);
    for (Eigen::Index r = 0; r < count; ++r) {
      const auto i = static_cast<std::size_t>(r);
      a.row(r) = Eigen::Map<const Eigen::RowVectorXd>(phase.rows[i].data(), a.cols());
      k(r) = series.stiffness(phase.ticks[i]);
    }
    const Eigen::VectorXd fitted = a * a.colPivHouseholderQr().solve(k).eval();
    for (Eigen::Index r = 0; r < count; ++r) felt[phase.ticks[static_cast<std::size_t>(r)]] = fitted(r);
  }
  return felt;
}

// Correlation coefficient of felt(t + shift) with the real stiffness.
double correlation(const Series& series, const std::vector<double>& felt, std::size_t begin,
                   std::size_t shift) {
  double sf = 0, sr = 0, sff = 0, srr = 0, sfr = 0, count = 0;
  for (std::size_t n = begin; n + shift < felt.size(); ++n) {
    const double f = felt[n + shift], r = series.stiffness(n);
    sf += f, sr += r, sff += f * f, srr += r * r, sfr += f * r, ++count;
  }
  return (sfr - sf * sr / count) / std::sqrt((sff - sf * sf / count) * (srr - sr * sr / count));
}

// Where the cross-correlation is largest, a parabola through its top.
double lag_s(const Series& series, const std::vector<double>& felt, std::size_t begin) {
  constexpr std::size_t kLongest = 60;
  std::vector<double> c;
  for (std::size_t shift = 0; shift <= kLongest; ++shift)
    c.push_back(correlation(series, felt, begin, shift));
  const auto top = static_cast<std::size_t>(std::max_element(c.begin(), c.end()) - c.begin());
  if (top == 0 || top == kLongest) return kServoS * static_cast<double>(top);
  const double bend = c[top - 1] - 2 * c[top] + c[top + 1];
  return kServoS * (static_cast<double>(top) + (c[top - 1] - c[top + 1]) / (2 * bend));
}

Filter judge(const Series& series, const std::string& name, std::vector<double> felt) {
  const auto begin = static_cast<std::size_t>(std::lround(kSettledS / kServoS));
  double squares = 0, mean = 0, largest = 0;
  for (std::size_t n = begin; n < felt.size(); ++n) {
    const double error = felt[n] - series.stiffness(n);
    squares += error * error;
    mean += series.stiffness(n);
    largest = std::abs(error) <= largest ? largest : std::abs(error);  // NaN stays
  }
  const auto count = static_cast<double>(felt.size() - begin);
  mean /= count;
  const double lag = lag_s(series, felt, begin);
  return {name, lag, std::sqrt(squares / count) / mean, largest / mean, std::move(felt)};
}

LayerFigures measure_layer(const service::TissueModel& model, const TouchedLayer& layer, Promises& promises) {
  const Series series = run_along(model, layer.row, kRateHz);
  LayerFigures out{layer.name};
  for (std::size_t n = 0; n < series.truth.size(); ++n) {
    out.time_s.push_back(series.truth[n].pose_time_s);
    out.x_m.push_back(series.truth[n].position_m.x());
    out.real_n_m.push_back(series.stiffness(n));
  }
  for (const std::string& name : renderer_names())
    out.filters.push_back(judge(series, name, rendered(series, name)));
  out.filters.push_back(judge(series, "exact tangent of the newest answer", expanded(series, true)));
  out.filters.push_back(judge(series, "best linear filter, force and tangent", best_linear(series, true)));
  out.filters.push_back(judge(series, "best linear filter, force alone", best_linear(series, false)));
  std::printf("\nfig14, %s, answers at %.0f Hz: lag (ms), RMS error, largest (of the mean stiffness)\n",
              layer.name, kRateHz);
  for (const Filter& f : out.filters) {
    std::printf("  %5.1f  %6.2f %%  %6.2f %%  %s\n", 1e3 * f.lag_s, 100 * f.rms_error, 100 * f.largest_error,
                f.name.c_str());
    if (f.name != "kalman" && f.name != "kalman-force") continue;
    const std::string of = snake_case(f.name + " on " + layer.name);
    promises.push_back({"stiffness_lag_of_" + of, f.lag_s, kLagS, "s"});
    promises.push_back(
        {"stiffness_rms_error_of_" + of + "_over_the_mean_stiffness", f.rms_error, layer.rms_max});
  }
  return out;
}

Figures measure(bool, Promises& promises) {
  const service::TissueModel model = paper_tissue(kPoissonRatio);
  Figures figures;
  for (const TouchedLayer& layer : kLayers) figures.layers.push_back(measure_layer(model, layer, promises));
  return figures;
}

// The paper's form: stiffness against time, the real one as circles, the filter's as stars.
void draw_layer(const LayerFigures& layer, const std::filesystem::path& file) {
  const auto curve_of = [&](const std::string& title, const std::vector<double>& values, std::size_t begin,
                            std::size_t every, const char* style) {
    Curve curve{.title = title, .style = style};
    begin += static_cast<std::size_t>(std::lround(kSettledS / kServoS));
    for (std::size_t n = begin; n < values.size(); n += every) curve.add(layer.time_s[n], values[n]);
    return curve;
  };
  const auto title = [](const Filter& f) {
    return fmt::format("{}: {:.1f} ms late, RMS error {:.1f} %", f.name, 1e3 * f.lag_s, 100 * f.rms_error);
  };
  const Filter &first = layer.filters[0], &second = layer.filters[1];
  plot(
      file,
      script_of({curve_of("real", layer.real_n_m, 0, 10, "points pt 6 ps 0.9 lc rgb 'black'"),
                 curve_of(title(first), first.stiffness_n_m, 5, 10, "points pt 3 ps 0.9 lc 1"),
                 curve_of(title(second), second.stiffness_n_m, 0, 1, "lines lw 1 lc 2")},
                "set key outside bottom center\n" +
                    axes("Kalman filter and real stiffness (the paper's Fig. 14), " + layer.layer +
                             ", 120 mm/s\\nof its curve the paper states no figures: 'only a short delay was "
                             "recorded'",
                         "time (s)", "stiffness (N/m)")));
}

void draw(const Figures& figures, const std::filesystem::path& folder) {
  draw_layer(figures.layers.at(0), folder / "fig14_surface.png");
  draw_layer(figures.layers.at(1), folder / "fig14_layer80.png");
}

}  // namespace

Part paper_fig14() {
  return make_part("fig14", measure, draw);
}

}  // namespace teletact::bench
