// Pictures of the elastography chart, from its JSON alone.
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

struct Factor {
  const char *name, *key, *label, *settings;
  double scale;
};
const Factor kFactors[] = {
    {"strain", "strain", "compression (%)", "set logscale x\n", 100},
    {"snr", "snr_db", "SNR (dB)", "", 1},
    {"correlation", "correlation", "correlation of the echoes, rho", "set xrange [*:*] reverse\n", 1},
    {"contrast", "contrast", "modulus contrast", "set logscale x\n", 1},
    {"diameter", "diameter_m", "inclusion diameter (mm)", "", 1e3}};

// A method's figure at a condition, over the seeds.
using Figure = std::function<std::vector<double>(const json& method)>;

// The conditions on a factor's curve by its value.
std::vector<std::pair<double, const json*>> along(const json& result, const Factor& factor) {
  std::vector<std::pair<double, const json*>> points;
  for (const json& c : result.at("conditions"))
    if (on_curve(c, factor.name)) points.emplace_back(factor.scale * number(c.at("case").at(factor.key)), &c);
  std::sort(points.begin(), points.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  return points;
}

std::vector<Curve> curves_over(const json& result, const Factor& factor, const Figure& figure) {
  std::vector<Curve> curves;
  std::map<std::string, std::size_t> index;
  for (const auto& [x, condition] : along(result, factor))
    for (const json& m : condition->at("methods")) {
      const std::string name = m.at("method");
      const auto [found, is_new] = index.try_emplace(name, curves.size());
      if (is_new) curves.push_back({name, m.at("ours").get<bool>()});
      std::vector<double> values = figure(m);
      values.erase(std::remove_if(values.begin(), values.end(), [](double v) { return !std::isfinite(v); }),
                   values.end());
      if (values.empty()) continue;
      const Interval i = interval95(values);
      Curve& curve = curves[found->second];
      curve.x.push_back(x);
      curve.y.push_back(i.mean);
      curve.half_width.push_back(std::min(i.half_width, 0.5 * i.mean));  // logarithmic axes show no more
    }
  return curves;
}

Curve theory(const json& result, const Factor& factor, const char* key, double scale,
             const std::string& title) {
  Curve curve{title};
  for (const auto& [x, condition] : along(result, factor)) {
    curve.x.push_back(x);
    curve.y.push_back(scale * number(condition->at(key)));
  }
  return curve;
}

const json& middle_of(const json& result) {
  for (const json& c : result.at("conditions"))
    if (on_curve(c, "middle")) return c;
  throw BenchError("the chart has no middle");
}

std::string head(const std::string& title, const std::string& x, const std::string& y) {
  return "set key outside bottom center horizontal\nset title '" + title + "'\nset xlabel '" + x +
         "'\nset ylabel '" + y + "'\n";
}

void draw_factor(const json& result, const Factor& factor, const std::filesystem::path& folder) {
  const double edge_m = result.at("edge_m");
  const auto matched = [&](const char* figure) {
    return curves_over(result, factor, [&](const json& m) { return matched_over_seeds(m, figure, edge_m); });
  };
  const std::string at = fmt::format(" at an edge width of {:.1f} mm (95 %)", 1e3 * edge_m);
  auto snre = matched("snre");
  if (factor.key == std::string("strain")) {
    snre.push_back(theory(result, factor, "filter_snre", 1, "strain filter, one window, not companded"));
    snre.push_back(theory(result, factor, "companded_filter_snre", 1, "strain filter, companded"));
  }
  plot(folder / fmt::format("elastography_snre_{}.png", factor.name),
       script_of(snre, std::string(factor.settings) + "set logscale y\n" +
                           head("SNRe" + at, factor.label, "SNRe")));
  plot(folder / fmt::format("elastography_cnre_{}.png", factor.name),
       script_of(matched("cnre"), std::string(factor.settings) + "set logscale y\n" +
                                      head("CNRe" + at, factor.label, "CNRe")));
  auto rmse = curves_over(result, factor, [](const json& m) {
    std::vector<double> um = over_seeds(m, "axial_rmse_m");
    for (double& v : um) v *= 1e6;
    return um;
  });
  rmse.push_back(theory(result, factor, "bound_m", 1e6, "bound of one kernel on one line (T2.5)"));
  rmse.push_back(theory(result, factor, "window_bound_m", 1e6, "bound of the window"));
  plot(folder / fmt::format("elastography_rmse_{}.png", factor.name),
       script_of(rmse, std::string(factor.settings) + "set logscale y\n" +
                           head("axial displacement of the valid nodes (95 %)", factor.label, "RMSE (um)")));
  plot(folder / fmt::format("elastography_valid_{}.png", factor.name),
       script_of(curves_over(result, factor, [](const json& m) { return over_seeds(m, "valid_fraction"); }),
                 std::string(factor.settings) + "set yrange [0:1.05]\n" +
                     head("part of the image that the method trusts", factor.label, "valid")));
}

// Error against time at every condition, and SNRe against edge width in the middle.
void draw_trades(const json& result, const std::filesystem::path& folder) {
  std::map<std::string, Curve> by_name;
  std::vector<Curve> time, edge;
  for (const json& c : result.at("conditions"))
    for (const json& m : c.at("methods")) {
      Curve& curve =
          by_name.try_emplace(m.at("method"), Curve{m.at("method"), m.at("ours").get<bool>(), false})
              .first->second;
      curve.x.push_back(1e3 * median_of(over_seeds(m, "seconds")));
      curve.y.push_back(1e6 * median_of(over_seeds(m, "axial_rmse_m")));
    }
  for (const json& m : middle_of(result).at("methods")) {
    time.push_back(by_name.at(m.at("method")));
    Curve curve{m.at("method"), m.at("ours").get<bool>()};
    for (std::size_t k = 0; k < m.at("edges").size(); ++k) {
      std::vector<double> values;
      for (const json& seed : m.at("seeds")) values.push_back(number(seed.at("snre")[k]));
      const Interval i = interval95(values);
      curve.x.push_back(1e3 * number(m.at("edges")[k].at("axial_m")));
      curve.y.push_back(i.mean);
      curve.half_width.push_back(i.half_width);
    }
    edge.push_back(curve);
  }
  plot(folder / "elastography_time.png",
       script_of(time, "set logscale xy\n" +
                           head("one point per condition; others on one thread, ours on the device",
                                "displacement of 60 x 40 mm (ms)", "axial RMSE (um)")));
  plot(folder / "elastography_edge.png",
       script_of(edge, "set logscale y\n" + head("the middle phantom: one point per strain kernel (95 %)",
                                                 "axial 20-80 % edge width (mm)", "SNRe")));
}

void draw_rigid(const json& rigid, const std::filesystem::path& folder) {
  std::vector<Curve> bias;
  for (const json& m : rigid.at("methods")) {
    Curve curve{m.at("method"), m.at("ours").get<bool>()};
    for (const json& phase : m.at("phases")) {
      curve.x.push_back(1e6 * number(phase.at("shift_m")));
      curve.y.push_back(1e6 * number(phase.at("bias_m")));
      curve.half_width.push_back(1e6 * number(phase.at("rmse_m")));
    }
    bias.push_back(curve);
  }
  plot(folder / "elastography_rigid.png",
       script_of(bias, head(fmt::format("a rigid shift by parts of a sample: bias, and RMSE as the bar; "
                                        "bound of one kernel {:.2f} um",
                                        1e6 * number(rigid.at("bound_m"))),
                            "shift (um)", "bias (um)")));
}

// The strain images of all methods beside the truth.
void draw_strain(const json& images, const std::filesystem::path& folder) {
  std::vector<NamedImage> all{{"truth", images.at("truth")}};
  for (const json& m : images.at("methods")) all.push_back({m.at("method"), m.at("strain")});
  draw_images(images.at("grid"), all, -100, "set cbrange [0:2]\nset cblabel 'compression (%)'\n",
              folder / "elastography_strain.png");
}

}  // namespace

void draw_images(const json& g, const std::vector<NamedImage>& images, double scale,
                 const std::string& settings, const std::filesystem::path& file) {
  const auto nx = g.at("nx").get<std::size_t>();
  const std::size_t rows = (images.size() + 2) / 3;
  std::string script = fmt::format("set terminal pngcairo size 1200,{} font 'sans,10'\nset output '{}'\n",
                                   300 * rows, file.string());
  for (std::size_t k = 0; k < images.size(); ++k) {
    script += fmt::format("$i{} << EOD\n", k);
    for (std::size_t n = 0; n < images[k].values.size(); ++n) {
      if (n > 0 && n % nx == 0) script += "\n";
      script +=
          fmt::format("{:.4g} {:.4g} {:.4g}\n",
                      1e3 * (number(g.at("origin_x_m")) + static_cast<double>(n % nx) * number(g.at("dx_m"))),
                      1e3 * (number(g.at("origin_y_m")) + static_cast<double>(n / nx) * number(g.at("dy_m"))),
                      scale * number(images[k].values[n]));
    }
    script += "EOD\n";
  }
  script += fmt::format(
      "set multiplot layout {},3\nset yrange [40:0]\nset xrange [0:60]\nset size ratio -1\n"
      "set palette rgbformulae 33,13,10\n{}",
      rows, settings);
  for (std::size_t k = 0; k < images.size(); ++k)
    script += fmt::format("set title '{}'\nplot $i{} using 1:2:3 with image notitle\n", images[k].title, k);
  plot(file, script + "unset multiplot\n");
}

void draw_elastography(const json& result, const std::string& to) {
  const std::filesystem::path folder(to);
  std::filesystem::create_directories(folder);
  for (const Factor& factor : kFactors) draw_factor(result, factor, folder);
  draw_trades(result, folder);
  draw_rigid(result.at("rigid"), folder);
  draw_strain(result.at("images"), folder);
  draw_modulus(result, folder);
}

}  // namespace teletact::bench
