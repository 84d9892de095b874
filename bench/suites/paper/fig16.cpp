// The paper's Fig. 16 (T6.3): stiffness felt along nine lines, from the natural surface to the one above the
// inclusion, through the service's own tissue model and contact.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "bench/suites/paper/paper.h"
#include "bench/suites/paper/tissue.h"
#include "service/contact/contact.h"
#include "service/tissue/tissue_model.h"

namespace teletact::bench {
namespace {

using nlohmann::json;

constexpr std::size_t kLines = 9, kCentreColumn = 25, kSideColumn = 10;
constexpr double kIndentationM = 0.002;
constexpr double kTolerance = 0.005;

// Contrast of the nine lines by an independent solver, to the digits it printed (T6.3).
struct Expected {
  double poisson_ratio;
  std::array<double, kLines> contrast;
};
constexpr std::array<Expected, 2> kExpected{
    {{0.49, {1.191, 1.207, 1.207, 1.209, 1.219, 1.230, 1.256, 1.487, 2.763}},
     {0.30, {1.209, 1.256, 1.268, 1.271, 1.267, 1.257, 1.253, 1.340, 2.984}}}};

// Force over displacement of every node of the line, one pressed at a time and free to move sideways.
std::vector<double> stiffness_n_m(const service::TissueModel& model, std::size_t line) {
  const auto compliance = model.condensed(line);
  const service::Fingertip node{.shape = service::FingertipShape::kNode};
  std::vector<double> stiffness;
  for (const double x_m : model.problem().grid.x_m) {
    const auto answer =
        service::solve_contact(model.problem(), line, *compliance, node, {x_m, kIndentationM});
    stiffness.push_back(-answer.force_n[1] / kIndentationM);
  }
  return stiffness;
}

json measure_at(const Expected& expected, std::vector<Target>& targets) {
  const service::TissueModel model = paper_tissue(expected.poisson_ratio);
  json lines = json::array();
  double worst = 0;
  std::printf("\nnu = %.2f: contrast, expected, line\n", expected.poisson_ratio);
  for (std::size_t line = 0; line < kLines; ++line) {
    const std::vector<double> stiffness = stiffness_n_m(model, line);
    const double contrast = stiffness[kCentreColumn] / stiffness[kSideColumn];
    const double error = std::abs(contrast / expected.contrast[line] - 1);
    worst = error <= worst ? worst : error;  // NaN stays
    lines.push_back({{"depth_m", model.problem().grid.y_m[line]},
                     {"stiffness_n_m", stiffness},
                     {"contrast", contrast},
                     {"expected_contrast", expected.contrast[line]}});
    std::printf("  %.3f  %.3f  y = %.0f mm\n", contrast, expected.contrast[line],
                1e3 * model.problem().grid.y_m[line]);
  }
  targets.push_back({fmt::format("fig16: contrast off the expected, nu = {:.2f}", expected.poisson_ratio),
                     worst, kTolerance, "of it"});
  return {{"poisson_ratio", expected.poisson_ratio}, {"x_m", model.problem().grid.x_m}, {"lines", lines}};
}

json measure(bool, std::vector<Target>& targets) {
  json cases = json::array();
  for (const Expected& expected : kExpected) cases.push_back(measure_at(expected, targets));
  return {{"indentation_m", kIndentationM}, {"cases", cases}};
}

// The paper's form: stiffness along the surface for the nine lines, over the largest of all.
void draw_lines(const json& figures, const std::filesystem::path& file) {
  double largest = 0;
  for (const json& line : figures["lines"])
    for (const double stiffness : line["stiffness_n_m"]) largest = std::max(largest, stiffness);
  std::string script, curves;
  for (std::size_t k = 0; k < figures["lines"].size(); ++k) {
    const json& line = figures["lines"][k];
    script += fmt::format("$line{} << EOD\n", k);
    for (std::size_t i = 0; i < figures["x_m"].size(); ++i)
      script += fmt::format("{:.2f} {:.6f}\n", 1e3 * figures["x_m"][i].get<double>(),
                            line["stiffness_n_m"][i].get<double>() / largest);
    script += "EOD\n";
    curves += fmt::format("{}$line{} with lines lw 2 lc palette frac {:.3f} title 'y = {:.0f} mm'",
                          k == 0 ? "" : ", ", k, static_cast<double>(k) / kLines,
                          1e3 * line["depth_m"].get<double>());
  }
  plot(file,
       script +
           fmt::format("set title \"Touching under the surface (the paper's Fig. 16), nu = {:.2f}\\n"
                       "of its curves the paper states no figures\"\n",
                       figures["poisson_ratio"].get<double>()) +
           "set xlabel 'x (mm)'\nset ylabel 'stiffness over the largest'\nset yrange [0:1.05]\n"
           "set key outside right\nunset colorbox\nset palette defined (0 '#bcd6ee', 1 '#08306b')\nplot " +
           curves + "\n");
}

void draw_contrast(const json& figures, const std::filesystem::path& file) {
  std::string script, curves;
  for (std::size_t k = 0; k < figures["cases"].size(); ++k) {
    const json& one = figures["cases"][k];
    script += fmt::format("$nu{} << EOD\n", k);
    for (const json& line : one["lines"])
      script += fmt::format("{:.0f} {:.6f} {:.6f}\n", 1e3 * line["depth_m"].get<double>(),
                            line["contrast"].get<double>(), line["expected_contrast"].get<double>());
    script += "EOD\n";
    const double nu = one["poisson_ratio"];
    curves += fmt::format(
        "{0}$nu{1} using 1:2 with lines lw 2 lc {2} title 'teletact, nu = {3:.2f}', "
        "$nu{1} using 1:3 with points pt 6 ps 1.6 lc {2} title 'expected, nu = {3:.2f}'",
        k == 0 ? "" : ", ", k, k + 1, nu);
  }
  plot(file,
       script +
           "set title \"How far the inclusion stands out, against the depth of the touched line\\n"
           "expected: an independent solver's; the paper states no figures: 'the closer ... the bigger'\"\n"
           "set xlabel 'depth of the touched line (mm)'\nset ylabel 'stiffness at the centre over that "
           "30 mm beside it'\n"
           "set key top left\nplot " +
           curves + "\n");
}

void draw(const json& figures, const std::string& folder) {
  for (const json& one : figures["cases"])
    draw_lines(one, std::filesystem::path(folder) /
                        fmt::format("fig16_nu{:03.0f}.png", 100 * one["poisson_ratio"].get<double>()));
  draw_contrast(figures, std::filesystem::path(folder) / "fig16_contrast.png");
}

}  // namespace

PaperExperiment paper_fig16() {
  return {"fig16", measure, draw};
}

}  // namespace teletact::bench
