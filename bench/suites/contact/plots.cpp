// Pictures of the contact chart.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>

#include "bench/curves.h"
#include "bench/suites/contact/contact.h"

namespace teletact::bench {
namespace {

const std::string kKeyBelow = "set key outside bottom center horizontal\n";

// Every method has one colour and mark in all pictures.
std::map<std::string, std::size_t> looks_of(const ContactFigures& figures) {
  std::map<std::string, std::size_t> looks;
  for (const CaseFigures& c : figures.cases)
    for (const MethodFigures& m : c.methods) looks.try_emplace(m.method, looks.size());
  return looks;
}

// One curve per method over the cases of a sweep, ordered by x; where `figure` is NaN there is no point.
std::vector<Curve> curves_over(const ContactFigures& figures, const std::string& sweep,
                               const std::function<double(const CaseFigures&)>& x,
                               const std::function<double(const MethodFigures&)>& figure) {
  std::vector<std::pair<double, const CaseFigures*>> cases;
  for (const CaseFigures& c : figures.cases)
    if (c.in(sweep)) cases.emplace_back(x(c), &c);
  std::sort(cases.begin(), cases.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<Curve> curves;
  std::map<std::string, std::size_t> index;
  const auto looks = looks_of(figures);
  for (const auto& [at, c] : cases)
    for (const MethodFigures& m : c->methods) {
      const double value = m.measured() ? figure(m) : std::nan("");
      if (std::isnan(value)) continue;
      const auto [found, is_new] = index.try_emplace(m.method, curves.size());
      if (is_new) curves.push_back({.title = m.method, .ours = m.ours, .look = looks.at(m.method)});
      curves[found->second].add(at, value);
    }
  return curves;
}

void draw_accuracy(const CaseFigures& base, const std::map<std::string, std::size_t>& looks,
                   const std::filesystem::path& file) {
  std::vector<Curve> curves;
  constexpr double kMin = 1e-16;  // an error of zero has no place on a logarithmic axis
  for (const MethodFigures& m : base.methods) {
    if (!m.measured()) continue;
    Curve curve{.title = m.method, .ours = m.ours, .line = m.iterative, .look = looks.at(m.method)};
    const auto add = [&](double error, double touch_s) {
      if (!std::isnan(error)) curve.add(std::max(kMin, error), 1e3 * (m.setup_s.p50 + touch_s));
    };
    for (const Rung& rung : m.ladder) add(rung.force_error, rung.seconds);
    if (m.ladder.empty()) add(m.force_error, m.touch_s.p50);
    curves.push_back(curve);
  }
  plot(file, script_of(curves, "set logscale xy\nset format x '10^{%L}'\n" + kKeyBelow +
                                   axes("61x61 nodes, nu 0.49, contrast 10, nodule", "error of the force",
                                        "set-up and one touch (ms)")));
}

void draw_cost(const ContactFigures& figures, const std::filesystem::path& file, const std::string& what,
               const std::function<double(const MethodFigures&)>& seconds) {
  auto curves = curves_over(
      figures, "size", [](const CaseFigures& c) { return static_cast<double>(c.unknowns); },
      [&](const MethodFigures& m) { return m.goal_met ? 1e3 * seconds(m) : std::nan(""); });
  for (Curve& curve : curves)
    if (const double slope = log_slope(curve.x, curve.y); std::isfinite(slope))
      curve.title += fmt::format(", n^{{{:.2f}}}", slope);
  plot(file, script_of(curves, "set logscale xy\n" + kKeyBelow +
                                   axes("force within 1e-6; nu 0.49, contrast 10, nodule", "unknowns n",
                                        what + " (ms)")));
}

void draw_iterations(const ContactFigures& figures, const std::filesystem::path& file,
                     const std::string& sweep, const std::function<double(const CaseFigures&)>& x,
                     const std::string& settings) {
  plot(file, script_of(curves_over(figures, sweep, x,
                                   [](const MethodFigures& m) {
                                     return m.iterative && m.goal_met ? static_cast<double>(m.iterations)
                                                                      : std::nan("");
                                   }),
                       "set logscale xy\n" + kKeyBelow + settings));
}

void draw_mesh(const std::vector<ConvergenceFigures>& convergence, const std::filesystem::path& file) {
  std::vector<Curve> curves;
  for (const ConvergenceFigures& c : convergence)
    for (const bool force : {true, false}) {
      Curve curve{
          fmt::format("{} of {}, contrast {}", force ? "force" : "displacement", c.pattern, c.contrast),
          force};
      for (const MeshFigures& m : c.meshes)
        curve.add(60 / (static_cast<double>(m.columns) - 1),
                  100 * (force ? m.force_error : m.displacement_error));
      curves.push_back(curve);
    }
  plot(file, script_of(curves, "set logscale xy\n" + kKeyBelow +
                                   axes("the mesh alone: 60 mm of tissue, coarser to finer",
                                        "distance of the nodes (mm)", "off the finest mesh (%)")));
}

}  // namespace

void draw_contact(const ContactFigures& figures, const std::filesystem::path& folder) {
  for (const CaseFigures& c : figures.cases)
    if (c.in("base")) draw_accuracy(c, looks_of(figures), folder / "contact_accuracy.png");
  draw_mesh(figures.convergence, folder / "contact_mesh.png");
  draw_cost(figures, folder / "contact_cost.png", "set-up and one touch",
            [](const MethodFigures& m) { return m.cold_s(); });
  draw_cost(figures, folder / "contact_touch.png", "one touch, after set-up",
            [](const MethodFigures& m) { return m.touch_s.p50; });
  const std::string iterations = "iterations to a force error of 1e-6";
  draw_iterations(
      figures, folder / "contact_iterations_nu.png", "poisson",
      [](const CaseFigures& c) { return 0.5 - c.poisson_ratio; },
      "set xrange [*:*] reverse\n" + axes("61x61 nodes, contrast 10, nodule", "1/2 - nu", iterations));
  draw_iterations(
      figures, folder / "contact_iterations_contrast.png", "contrast",
      [](const CaseFigures& c) { return c.contrast; },
      axes("61x61 nodes, nu 0.49, nodule", "contrast", iterations));
}

}  // namespace teletact::bench
