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

#include "bench/stability/servo_period.h"
#include "bench/suites/paper/paper.h"
#include "bench/suites/paper/tissue.h"
#include "client/render/renderers.h"
#include "service/contact/contact.h"
#include "service/tissue/tissue_model.h"

namespace teletact::bench {
namespace {

using client::ForceSample;
using client::ToolPose;
using client::Vector3;
using nlohmann::json;

constexpr double kSpeedMS = 0.12, kIndentationM = 0.002;
constexpr double kBeginM = 0.006, kEndM = 0.094;  // the footprint stays on the model
constexpr double kRateHz = 100;
constexpr double kPoissonRatio = 0.49;
constexpr double kSettledS = 0.05;  // before, the filters have seen too little
constexpr double kLagS = 0.010;
constexpr std::size_t kAnswersFitted = 4;

struct Line {
  const char* name;
  std::size_t row;
  double rms_most;  // promised, of the mean stiffness
};
constexpr std::array<Line, 2> kLines{{{"surface", 0, 0.03}, {"line 80 mm", 8, 0.10}}};

struct Series {
  std::vector<ForceSample> truth;  // one per servo period
  std::size_t answer_every = 0;    // servo periods
  double stiffness(std::size_t tick) const { return -truth[tick].force_n.y() / kIndentationM; }
};

// There and back. A touched node's force ripples between the nodes (T4.5b), so its footprint is one spacing
// wide.
Series run_along(const service::TissueModel& model, std::size_t row, double rate_hz) {
  const auto compliance = model.condensed(row);
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
  const auto renderer = client::make_renderer(name, kServoS);
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

json judge(const Series& series, const std::string& name, const std::vector<double>& felt) {
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
  return {{"name", name},
          {"lag_s", lag_s(series, felt, begin)},
          {"rms_error", std::sqrt(squares / count) / mean},
          {"largest_error", largest / mean},
          {"stiffness_n_m", felt}};
}

json measure_line(const service::TissueModel& model, const Line& line, std::vector<Target>& targets) {
  const Series series = run_along(model, line.row, kRateHz);
  std::vector<double> time_s, x_m, real;
  for (std::size_t n = 0; n < series.truth.size(); ++n) {
    time_s.push_back(series.truth[n].pose_time_s);
    x_m.push_back(series.truth[n].position_m.x());
    real.push_back(series.stiffness(n));
  }
  json rows = json::array();
  for (const std::string& name : client::renderer_names())
    rows.push_back(judge(series, name, rendered(series, name)));
  rows.push_back(judge(series, "exact tangent of the newest answer", expanded(series, true)));
  rows.push_back(judge(series, "best linear filter, force and tangent", best_linear(series, true)));
  rows.push_back(judge(series, "best linear filter, force alone", best_linear(series, false)));
  std::printf("\nfig14, %s, answers at %.0f Hz: lag (ms), RMS error, largest (of the mean stiffness)\n",
              line.name, kRateHz);
  for (const json& row : rows) {
    std::printf("  %5.1f  %6.2f %%  %6.2f %%  %s\n", 1e3 * row["lag_s"].get<double>(),
                100 * row["rms_error"].get<double>(), 100 * row["largest_error"].get<double>(),
                row["name"].get<std::string>().c_str());
    const std::string name = row["name"];
    if (name != "kalman" && name != "kalman-force") continue;
    targets.push_back({fmt::format("fig14, {}: lag of {}", line.name, name), row["lag_s"], kLagS, "s"});
    targets.push_back({fmt::format("fig14, {}: RMS error of {}", line.name, name), row["rms_error"],
                       line.rms_most, "of the mean stiffness"});
  }
  return {{"line", line.name}, {"time_s", time_s}, {"x_m", x_m}, {"real_n_m", real}, {"filters", rows}};
}

json measure(bool, std::vector<Target>& targets) {
  const service::TissueModel model = paper_tissue(kPoissonRatio);
  json lines = json::array();
  for (const Line& line : kLines) lines.push_back(measure_line(model, line, targets));
  return {{"speed_m_s", kSpeedMS}, {"indentation_m", kIndentationM}, {"rate_hz", kRateHz}, {"lines", lines}};
}

// The paper's form: stiffness against time, the real one as circles, the filter's as stars.
void draw_line(const json& figures, const std::filesystem::path& file) {
  std::string script = "$felt << EOD\n";
  const std::size_t ticks = figures["time_s"].size();
  const auto begin = static_cast<std::size_t>(std::lround(kSettledS / kServoS));
  for (std::size_t n = begin; n < ticks; ++n)
    script += fmt::format("{:.4f} {:.5f} {:.5f} {:.5f}\n", figures["time_s"][n].get<double>(),
                          figures["real_n_m"][n].get<double>(),
                          figures["filters"][0]["stiffness_n_m"][n].get<double>(),
                          figures["filters"][1]["stiffness_n_m"][n].get<double>());
  script += "EOD\n";
  const auto title = [&](std::size_t k) {
    return fmt::format("{}: {:.1f} ms late, RMS error {:.1f} %",
                       figures["filters"][k]["name"].get<std::string>(),
                       1e3 * figures["filters"][k]["lag_s"].get<double>(),
                       100 * figures["filters"][k]["rms_error"].get<double>());
  };
  plot(file,
       script +
           fmt::format("set title \"Kalman filter and real stiffness (the paper's Fig. 14), {}, 120 mm/s\\n"
                       "of its curve the paper states no figures: 'only a short delay was recorded'\"\n",
                       figures["line"].get<std::string>()) +
           "set xlabel 'time (s)'\nset ylabel 'stiffness (N/m)'\nset key outside bottom center\n"
           "plot $felt using 1:2 every 10 with points pt 6 ps 0.9 lc rgb 'black' title 'real', "
           "$felt using 1:3 every 10::5 with points pt 3 ps 0.9 lc 1 title '" +
           title(0) + "', $felt using 1:4 with lines lw 1 lc 2 title '" + title(1) + "'\n");
}

void draw(const json& figures, const std::string& folder) {
  for (std::size_t k = 0; k < figures["lines"].size(); ++k)
    draw_line(figures["lines"][k],
              std::filesystem::path(folder) / (k == 0 ? "fig14_surface.png" : "fig14_line80.png"));
}

}  // namespace

PaperExperiment paper_fig14() {
  return {"fig14", measure, draw};
}

}  // namespace teletact::bench
