// The modulus part of the chart: acceptance 4 and its pictures, from the JSON alone.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <map>

#include "bench/curves.h"
#include "bench/phantoms/metrics.h"
#include "bench/suites/elastography/elastography.h"

namespace teletact::bench {
namespace {

using nlohmann::json;

struct Promise {
  double least = 0, most = 1e300;  // of recovered over true contrast
};

Promise direct_promise(double contrast) {
  return {contrast <= 3 ? 0.85 : contrast <= 5 ? 0.70 : 0.50};
}
Promise iterative_promise(double contrast) {
  return contrast <= 5 ? Promise{0.85, 1.10} : Promise{0.75, 1.15};
}

bool keeps(const json& seed, const Promise& promise, double contrast, double background_pa) {
  if (seed.contains("failed")) return false;
  const double kept = number(seed.at("contrast")) / contrast;
  return kept >= promise.least && kept <= promise.most && number(seed.at("dice")) >= 0.85 &&
         std::abs(number(seed.at("background_pa")) / background_pa - 1) <= 0.05;
}

void add_promise(const json& modulus, const std::string& method,
                 const std::function<Promise(double)>& promise, std::vector<Target>& targets) {
  std::map<double, std::pair<double, double>> by_contrast;  // kept, seeds
  for (const json& c : modulus.at("cases"))
    for (const json& m : c.at("methods")) {
      if (m.at("method") != method) continue;
      const double contrast = number(c.at("contrast"));
      for (const json& seed : m.at("seeds")) {
        by_contrast[contrast].first +=
            keeps(seed, promise(contrast), contrast, number(modulus.at("background_pa")));
        by_contrast[contrast].second += 1;
      }
    }
  for (const auto& [contrast, share] : by_contrast)
    targets.push_back(
        {fmt::format("4. {}, contrast {:.0f}: seeds with contrast, background and Dice as promised", method,
                     contrast),
         share.first / share.second, 0.9, "", false});
}

std::vector<double> figures(const json& method, const char* key, double over = 1) {
  std::vector<double> values;
  for (const json& seed : method.at("seeds"))
    if (!seed.contains("failed") && std::isfinite(number(seed.at(key))))
      values.push_back(number(seed.at(key)) / over);
  return values;
}

using Figure = std::function<std::vector<double>(const json& of_case, const json& method)>;

std::vector<Curve> curves_over_contrast(const json& modulus, const Figure& figure) {
  std::vector<Curve> curves;
  std::map<std::string, std::map<double, std::vector<double>>> values;
  std::map<std::string, bool> ours;
  for (const json& c : modulus.at("cases"))
    for (const json& m : c.at("methods")) {
      const std::vector<double> more = figure(c, m);
      auto& all = values[m.at("method")][number(c.at("contrast"))];
      all.insert(all.end(), more.begin(), more.end());
      ours[m.at("method")] = m.at("ours");
    }
  for (const auto& [name, by_contrast] : values) {
    Curve curve{name, ours.at(name)};
    for (const auto& [contrast, all] : by_contrast) {
      if (all.empty()) continue;
      const Interval i = interval95(all);
      curve.x.push_back(contrast);
      curve.y.push_back(i.mean);
      curve.half_width.push_back(i.half_width);
    }
    curves.push_back(curve);
  }
  return curves;
}

void draw_time(const json& modulus, const std::filesystem::path& folder) {
  std::map<std::string, Curve> curves;
  for (const json& c : modulus.at("cases"))
    for (const json& m : c.at("methods")) {
      std::vector<double> error;
      for (const double kept : figures(m, "contrast", number(c.at("contrast"))))
        error.push_back(100 * std::abs(kept - 1));
      if (error.empty()) continue;
      Curve& curve =
          curves.try_emplace(m.at("method"), Curve{m.at("method"), m.at("ours").get<bool>(), false})
              .first->second;
      curve.x.push_back(1e3 * median_of(figures(m, "seconds")));
      curve.y.push_back(std::max(0.1, median_of(error)));
    }
  std::vector<Curve> all;
  for (const auto& [name, curve] : curves) all.push_back(curve);
  plot(
      folder / "elastography_modulus_time.png",
      script_of(all,
                "set logscale xy\nset key outside bottom center horizontal\nset xlabel 'modulus from the "
                "displacement (ms)'\nset ylabel 'contrast off by (%)'\nset title 'one point per contrast and "
                "size; others on one thread, ours on the device'\n"));
}

}  // namespace

void add_modulus_targets(const json& modulus, std::vector<Target>& targets) {
  add_promise(modulus, "ours, direct", direct_promise, targets);
  add_promise(modulus, "ours, iterative", iterative_promise, targets);
}

void draw_modulus(const json& result, const std::filesystem::path& folder) {
  const json& modulus = result.at("modulus");
  const std::string head =
      "set key outside bottom center horizontal\nset logscale x\nset xlabel 'true contrast'\n";
  auto contrast = curves_over_contrast(
      modulus, [](const json& c, const json& m) { return figures(m, "contrast", number(c.at("contrast"))); });
  plot(folder / "elastography_modulus_contrast.png",
       script_of(
           contrast,
           head + "set yrange [0:1.5]\nset ylabel 'recovered over true contrast'\nset title '1 %, 30 dB, rho "
                  ".99; inner 70 % of the radius over the background (95 %)'\n"));
  plot(folder / "elastography_modulus_dice.png",
       script_of(curves_over_contrast(modulus, [](const json&, const json& m) { return figures(m, "dice"); }),
                 head + "set yrange [0:1]\nset ylabel 'Dice'\nset title 'Otsu on log E against the true disc "
                        "(95 %)'\n"));
  const double background_pa = number(modulus.at("background_pa"));
  plot(
      folder / "elastography_modulus_background.png",
      script_of(curves_over_contrast(
                    modulus,
                    [&](const json&, const json& m) { return figures(m, "background_pa", background_pa); }),
                head + "set ylabel 'background over its truth'\nset title 'with the force sensor (95 %)'\n"));
  draw_time(modulus, folder);
  const json& first = modulus.at("cases").at(modulus.at("cases").size() > 1 ? 1 : 0);
  std::vector<NamedImage> images;
  for (const json& m : first.at("methods"))
    if (m.contains("image")) images.push_back({m.at("method"), m.at("image")});
  draw_images(result.at("images").at("grid"), images, 1e-3,
              fmt::format("set cbrange [0:{}]\nset cblabel 'kPa'\n",
                          std::ceil(1.2e-3 * background_pa * number(first.at("contrast")))),
              folder / "elastography_modulus.png");
}

}  // namespace teletact::bench
