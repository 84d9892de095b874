// The modulus part of the chart: what is promised, and its pictures.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>

#include "bench/curves.h"
#include "bench/suites/elastography/elastography.h"

namespace teletact::bench {
namespace {

struct Range {
  double least = 0, most = 1e300;  // of recovered over true contrast
};

Range of_direct(double contrast) {
  return {contrast <= 3 ? 0.85 : contrast <= 5 ? 0.70 : 0.50};
}
Range of_iterative(double contrast) {
  return contrast <= 5 ? Range{0.85, 1.10} : Range{0.75, 1.15};
}

bool keeps(const ModulusSeed& seed, const Range& range, double contrast, double background_pa) {
  const double kept = seed.quality.contrast / contrast;
  return seed.failed.empty() && kept >= range.least && kept <= range.most && seed.quality.dice >= 0.85 &&
         std::abs(seed.quality.background / background_pa - 1) <= 0.05;
}

void add_promise(const ModulusFigures& modulus, const std::string& method, Range (*range)(double),
                 Promises& promises) {
  std::map<double, std::pair<double, double>> by_contrast;  // kept, seeds
  for (const ModulusCase& c : modulus.cases)
    for (const ModulusMethodFigures& m : c.methods) {
      if (m.method != method) continue;
      for (const ModulusSeed& seed : m.seeds) {
        auto& [kept, seeds] = by_contrast[c.contrast];
        kept += keeps(seed, range(c.contrast), c.contrast, modulus.background_pa), ++seeds;
      }
    }
  for (const auto& [contrast, share] : by_contrast)
    promises.push_back(
        {fmt::format("modulus_{}_contrast_{:.0f}_share_of_seeds_as_promised", snake_case(method), contrast),
         share.first / share.second, 0.9, "", false});
}

using Figure = std::function<double(const ModulusCase&, const ModulusSeed&)>;

std::vector<double> over_seeds(const ModulusCase& c, const ModulusMethodFigures& m, const Figure& figure) {
  std::vector<double> values;
  for (const ModulusSeed& seed : m.seeds)
    if (const double v = figure(c, seed); seed.failed.empty() && std::isfinite(v)) values.push_back(v);
  return values;
}

double recovered(const ModulusCase& c, const ModulusSeed& seed) {
  return seed.quality.contrast / c.contrast;
}

void draw_over_contrast(const ModulusFigures& modulus, const std::filesystem::path& file,
                        const Figure& figure, const std::string& y, const std::string& title,
                        const std::string& settings) {
  std::map<std::string, Curve> curves;
  std::map<std::string, std::map<double, std::vector<double>>> values;
  for (const ModulusCase& c : modulus.cases)
    for (const ModulusMethodFigures& m : c.methods) {
      curves.try_emplace(m.method, Curve{m.method, m.ours});
      std::vector<double>& all = values[m.method][c.contrast];
      for (const double v : over_seeds(c, m, figure)) all.push_back(v);
    }
  std::vector<Curve> drawn;
  for (auto& [name, curve] : curves) {
    for (const auto& [contrast, all] : values[name]) {
      if (all.empty()) continue;
      const Interval i = interval95(all);
      curve.add(contrast, i.mean);
      curve.half_width.push_back(i.half_width);
    }
    drawn.push_back(curve);
  }
  plot(file, script_of(drawn, "set key outside bottom center horizontal\nset logscale x\n" + settings +
                                  axes(title, "true contrast", y)));
}

void draw_time(const ModulusFigures& modulus, const std::filesystem::path& file) {
  std::map<std::string, Curve> curves;
  for (const ModulusCase& c : modulus.cases)
    for (const ModulusMethodFigures& m : c.methods) {
      const auto error = over_seeds(c, m, [](const ModulusCase& at, const ModulusSeed& seed) {
        return 100 * std::abs(recovered(at, seed) - 1);
      });
      const auto seconds =
          over_seeds(c, m, [](const auto&, const ModulusSeed& seed) { return seed.seconds; });
      if (!error.empty())
        curves.try_emplace(m.method, Curve{m.method, m.ours, false})
            .first->second.add(1e3 * median_of(seconds), std::max(0.1, median_of(error)));
    }
  std::vector<Curve> all;
  for (const auto& [name, curve] : curves) all.push_back(curve);
  plot(file, script_of(all, "set logscale xy\nset key outside bottom center horizontal\n" +
                                axes("one point per contrast and size; others on one thread, ours on the "
                                     "device",
                                     "modulus from the displacement (ms)", "contrast off by (%)")));
}

}  // namespace

void add_modulus_promises(const ModulusFigures& modulus, Promises& promises) {
  add_promise(modulus, "ours, direct", of_direct, promises);
  add_promise(modulus, "ours, iterative", of_iterative, promises);
}

void draw_modulus(const ElastographyFigures& figures, const std::filesystem::path& folder) {
  const ModulusFigures& modulus = figures.modulus;
  draw_over_contrast(
      modulus, folder / "elastography_modulus_contrast.png", recovered, "recovered over true contrast",
      "1 %, 30 dB, rho 0.99; inner 70 % of the radius over the background (95 %)", "set yrange [0:1.5]\n");
  draw_over_contrast(
      modulus, folder / "elastography_modulus_dice.png",
      [](const auto&, const ModulusSeed& seed) { return seed.quality.dice; }, "Dice",
      "Otsu on log E against the true disc (95 %)", "set yrange [0:1]\n");
  draw_over_contrast(
      modulus, folder / "elastography_modulus_background.png",
      [&](const auto&, const ModulusSeed& seed) { return seed.quality.background / modulus.background_pa; },
      "background over its truth", "with the force sensor (95 %)", "");
  draw_time(modulus, folder / "elastography_modulus_time.png");
  const ModulusCase& first = modulus.cases.at(modulus.cases.size() > 1 ? 1 : 0);
  std::vector<NamedImage> images;
  for (const ModulusMethodFigures& m : first.methods)
    if (!m.image.empty()) images.push_back({m.method, m.image});
  draw_images(figures.images.grid, images, 1e-3,
              fmt::format("set cbrange [0:{}]\nset cblabel 'kPa'\n",
                          std::ceil(1.2e-3 * modulus.background_pa * first.contrast)),
              folder / "elastography_modulus.png");
}

}  // namespace teletact::bench
