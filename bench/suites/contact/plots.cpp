// Pictures of the contact chart, from its JSON alone.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>

#include "bench/curves.h"
#include "bench/suites/contact/contact.h"

namespace teletact::bench {
namespace {

using nlohmann::json;

bool in_sweep(const json& of_case, const std::string& sweep) {
  const json& names = of_case.at("sweeps");
  return std::find(names.begin(), names.end(), sweep) != names.end();
}

// Every method has one colour and mark in all pictures.
std::map<std::string, std::size_t> looks_of(const json& result) {
  std::map<std::string, std::size_t> looks;
  for (const json& c : result.at("cases"))
    for (const json& m : c.at("methods")) looks.try_emplace(m.at("method"), looks.size());
  return looks;
}

// One curve per method over the cases of a sweep, ordered by x; where `figure` is NaN there is no point.
std::vector<Curve> curves_over(const json& result, const std::string& sweep,
                               const std::function<double(const json&)>& x,
                               const std::function<double(const json&)>& figure) {
  std::vector<std::pair<double, const json*>> cases;
  for (const json& c : result.at("cases"))
    if (in_sweep(c, sweep)) cases.emplace_back(x(c), &c);
  std::sort(cases.begin(), cases.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<Curve> curves;
  std::map<std::string, std::size_t> index;
  const auto looks = looks_of(result);
  for (const auto& [at, c] : cases)
    for (const json& m : measured_methods(*c)) {
      const double value = figure(m);
      if (std::isnan(value)) continue;
      const std::string name = m.at("method");
      const auto [found, is_new] = index.try_emplace(name, curves.size());
      if (is_new) curves.push_back({.title = name, .ours = m.at("ours"), .look = looks.at(name)});
      curves[found->second].x.push_back(at);
      curves[found->second].y.push_back(value);
    }
  return curves;
}

double iterations_to_goal(const json& m) {
  return m.at("iterative").get<bool>() && m.at("goal_met").get<bool>() ? m.at("iterations").get<double>()
                                                                       : std::nan("");
}

void draw_accuracy(const json& base, const std::map<std::string, std::size_t>& looks,
                   const std::filesystem::path& folder) {
  std::vector<Curve> curves;
  constexpr double kLeast = 1e-16;  // an error of zero has no place on a logarithmic axis
  for (const json& m : measured_methods(base)) {
    Curve curve{.title = m.at("method"), .ours = m.at("ours"), .line = m.at("iterative"), .look = {}};
    curve.look = looks.at(curve.title);
    const double setup_s = m.at("setup_s").at("p50");
    const auto add = [&](const json& error, double touch_s) {
      if (error.is_null()) return;  // NaN
      curve.x.push_back(std::max(kLeast, error.get<double>()));
      curve.y.push_back(1e3 * (setup_s + touch_s));
    };
    if (m.contains("ladder")) {
      for (const json& rung : m.at("ladder")) add(rung.at("force_error"), rung.at("seconds"));
    } else {
      add(m.at("force_error"), m.at("touch_s").at("p50"));
    }
    curves.push_back(curve);
  }
  plot(folder / "contact_accuracy.png",
       script_of(curves,
                 "set logscale xy\nset format x '10^{%L}'\nset xlabel 'error of the force'\n"
                 "set ylabel 'set-up and one touch (ms)'\nset key outside bottom center horizontal\n"
                 "set title '61x61 nodes, nu 0.49, contrast 10, nodule'\n"));
}

void draw_cost(const json& result, const std::filesystem::path& file, const std::string& what,
               const std::function<double(const json&)>& seconds) {
  auto curves = curves_over(
      result, "size", [](const json& c) { return c.at("unknowns").get<double>(); },
      [&](const json& m) { return m.at("goal_met").get<bool>() ? 1e3 * seconds(m) : std::nan(""); });
  for (Curve& curve : curves)
    if (const double slope = log_slope(curve.x, curve.y); std::isfinite(slope))
      curve.title += fmt::format(", n^{{{:.2f}}}", slope);
  plot(file, script_of(curves, "set logscale xy\nset xlabel 'unknowns n'\nset ylabel '" + what +
                                   " (ms)'\nset key outside bottom center horizontal\n"
                                   "set title 'force within 1e-6; nu 0.49, contrast 10, nodule'\n"));
}

void draw_mesh(const json& convergence, const std::filesystem::path& file) {
  std::vector<Curve> curves;
  for (const json& c : convergence)
    for (const char* what : {"force_error", "displacement_error"}) {
      Curve curve{fmt::format("{} of {}, contrast {}", what[0] == 'f' ? "force" : "displacement",
                              c.at("pattern").get<std::string>(), c.at("contrast").get<double>()),
                  what[0] == 'f'};
      for (const json& m : c.at("meshes")) {
        curve.x.push_back(60 / (m.at("columns").get<double>() - 1));
        curve.y.push_back(100 * m.at(what).get<double>());
      }
      curves.push_back(curve);
    }
  plot(file, script_of(curves,
                       "set logscale xy\nset xlabel 'distance of the nodes (mm)'\n"
                       "set ylabel 'off the finest mesh (%)'\nset key outside bottom center horizontal\n"
                       "set title 'the mesh alone: 60 mm of tissue, coarser to finer'\n"));
}

}  // namespace

void draw_contact(const json& result, const std::string& to) {
  const std::filesystem::path folder(to);
  std::filesystem::create_directories(folder);
  for (const json& c : result.at("cases"))
    if (in_sweep(c, "base")) draw_accuracy(c, looks_of(result), folder);
  if (result.contains("convergence")) draw_mesh(result.at("convergence"), folder / "contact_mesh.png");
  draw_cost(result, folder / "contact_cost.png", "set-up and one touch", cold_s);
  draw_cost(result, folder / "contact_touch.png", "one touch, after set-up",
            [](const json& m) { return m.at("touch_s").at("p50").get<double>(); });
  const std::string key =
      "set logscale y\nset key outside bottom center horizontal\n"
      "set ylabel 'iterations to a force error of 1e-6'\n";
  plot(folder / "contact_iterations_nu.png",
       script_of(
           curves_over(
               result, "poisson", [](const json& c) { return 0.5 - c.at("poisson_ratio").get<double>(); },
               iterations_to_goal),
           key + "set logscale x\nset xrange [*:*] reverse\nset xlabel '1/2 - nu'\n"
                 "set title '61x61 nodes, contrast 10, nodule'\n"));
  plot(folder / "contact_iterations_contrast.png",
       script_of(curves_over(
                     result, "contrast", [](const json& c) { return c.at("contrast").get<double>(); },
                     iterations_to_goal),
                 key + "set logscale x\nset xlabel 'contrast'\n"
                       "set title '61x61 nodes, nu 0.49, nodule'\n"));
}

}  // namespace teletact::bench
