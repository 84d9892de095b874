// Pictures of the elastography chart.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>

#include "bench/curves.h"
#include "bench/suites/elastography/elastography.h"

namespace teletact::bench {
namespace {

const std::string kKeyBelow = "set key outside bottom center horizontal\n";

struct Factor {
  const char* name;
  double PhantomCase::*value;
  const char *label, *settings;
  double scale;
};
const Factor kFactors[] = {{"strain", &PhantomCase::strain, "compression (%)", "set logscale x\n", 100},
                           {"snr", &PhantomCase::snr_db, "SNR (dB)", "", 1},
                           {"correlation", &PhantomCase::correlation, "correlation of the echoes, rho",
                            "set xrange [*:*] reverse\n", 1},
                           {"contrast", &PhantomCase::contrast, "modulus contrast", "set logscale x\n", 1},
                           {"diameter", &PhantomCase::diameter_m, "inclusion diameter (mm)", "", 1e3}};

// A method's figure at a condition, over the seeds.
using Figure = std::function<std::vector<double>(const TrackerFigures&)>;

// The conditions on a factor's curve by its value.
std::vector<std::pair<double, const Condition*>> along(const ElastographyFigures& figures,
                                                       const Factor& factor) {
  std::vector<std::pair<double, const Condition*>> points;
  for (const Condition& c : figures.conditions)
    if (c.on(factor.name)) points.emplace_back(factor.scale * c.of.*factor.value, &c);
  std::sort(points.begin(), points.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  return points;
}

std::vector<Curve> curves_over(const ElastographyFigures& figures, const Factor& factor,
                               const Figure& figure) {
  std::vector<Curve> curves;
  for (const TrackerFigures& m : figures.middle().methods) curves.push_back({m.method, m.ours});
  for (const auto& [x, condition] : along(figures, factor))
    for (std::size_t m = 0; m < curves.size(); ++m) {
      std::vector<double> values = figure(condition->methods[m]);
      std::erase_if(values, [](double v) { return !std::isfinite(v); });
      if (values.empty()) continue;
      const Interval i = interval95(values);
      curves[m].add(x, i.mean);
      // Logarithmic axes show no more.
      curves[m].half_width.push_back(std::min(i.half_width, 0.5 * i.mean));
    }
  return curves;
}

Curve theory(const ElastographyFigures& figures, const Factor& factor, double Condition::*figure,
             double scale, const std::string& title) {
  Curve curve{title};
  for (const auto& [x, condition] : along(figures, factor)) curve.add(x, scale * condition->*figure);
  return curve;
}

void draw_factor(const ElastographyFigures& figures, const Factor& factor,
                 const std::filesystem::path& folder) {
  const auto draw = [&](const char* what, const std::vector<Curve>& curves, const std::string& title,
                        const char* y, const std::string& settings) {
    plot(folder / fmt::format("elastography_{}_{}.png", what, factor.name),
         script_of(curves, factor.settings + settings + kKeyBelow + axes(title, factor.label, y)));
  };
  const auto matched = [&](double StrainQuality::*figure) {
    return curves_over(figures, factor, [&](const TrackerFigures& m) { return m.at_edge(figure); });
  };
  const std::string at = fmt::format(" at an edge width of {:.1f} mm (95 %)", 1e3 * figures.edge_m);
  auto snre = matched(&StrainQuality::snre);
  if (factor.value == &PhantomCase::strain) {
    snre.push_back(
        theory(figures, factor, &Condition::filter_snre, 1, "strain filter, one window, not companded"));
    snre.push_back(theory(figures, factor, &Condition::companded_filter_snre, 1, "strain filter, companded"));
  }
  draw("snre", snre, "SNRe" + at, "SNRe", "set logscale y\n");
  draw("cnre", matched(&StrainQuality::cnre), "CNRe" + at, "CNRe", "set logscale y\n");
  auto rmse = curves_over(figures, factor, [](const TrackerFigures& m) {
    return m.over_seeds([](const SeedFigures& s) { return 1e6 * s.errors.axial_rmse_m; });
  });
  rmse.push_back(theory(figures, factor, &Condition::bound_m, 1e6, "bound of one kernel on one line (T2.5)"));
  rmse.push_back(theory(figures, factor, &Condition::window_bound_m, 1e6, "bound of the window"));
  draw("rmse", rmse, "axial displacement of the valid nodes (95 %)", "RMSE (um)", "set logscale y\n");
  const auto valid = curves_over(figures, factor, [](const TrackerFigures& m) {
    return m.over_seeds([](const SeedFigures& s) { return s.errors.valid_fraction; });
  });
  draw("valid", valid, "part of the image that the method trusts", "valid", "set yrange [0:1.05]\n");
}

// Error against time at every condition, and SNRe against edge width in the middle.
void draw_trades(const ElastographyFigures& figures, const std::filesystem::path& folder) {
  std::vector<Curve> time, edge;
  for (const TrackerFigures& m : figures.middle().methods) {
    Curve trade{m.method, m.ours};
    for (std::size_t k = 0; k < m.edges.size(); ++k) {
      std::vector<double> values;
      for (const SeedFigures& seed : m.seeds) values.push_back(seed.strain[k].snre);
      const Interval i = interval95(values);
      trade.add(1e3 * m.edges[k].axial_m, i.mean);
      trade.half_width.push_back(i.half_width);
    }
    edge.push_back(trade);
    Curve cost{m.method, m.ours, false};
    for (const Condition& c : figures.conditions) {
      const TrackerFigures& here = c.methods[time.size()];
      cost.add(1e3 * median_of(here.over_seeds([](const SeedFigures& s) { return s.seconds; })),
               1e6 * median_of(here.over_seeds([](const SeedFigures& s) { return s.errors.axial_rmse_m; })));
    }
    time.push_back(cost);
  }
  plot(folder / "elastography_time.png",
       script_of(time, "set logscale xy\n" + kKeyBelow +
                           axes("one point per condition; others on one thread, ours on the device",
                                "displacement of 60 x 40 mm (ms)", "axial RMSE (um)")));
  plot(folder / "elastography_edge.png",
       script_of(edge, "set logscale y\n" + kKeyBelow +
                           axes("the middle phantom: one point per strain kernel (95 %)",
                                "axial 20-80 % edge width (mm)", "SNRe")));
}

void draw_rigid(const RigidFigures& rigid, const std::filesystem::path& file) {
  std::vector<Curve> bias;
  for (const RigidMethod& m : rigid.methods) {
    bias.push_back({m.method, m.ours});
    for (const RigidPhase& phase : m.phases) {
      bias.back().add(1e6 * phase.shift_m, 1e6 * phase.bias_m);
      bias.back().half_width.push_back(1e6 * phase.rmse_m);
    }
  }
  plot(file,
       script_of(bias, kKeyBelow + axes(fmt::format("a rigid shift by parts of a sample: bias, and RMSE "
                                                    "as the bar; bound of one kernel {:.2f} um",
                                                    1e6 * rigid.bound_m),
                                        "shift (um)", "bias (um)")));
}

}  // namespace

void draw_images(const service::ImageGrid& g, const std::vector<NamedImage>& images, double scale,
                 const std::string& settings, const std::filesystem::path& file) {
  const std::size_t rows = (images.size() + 2) / 3;
  std::string script = fmt::format(
      "set terminal pngcairo size 1200,{} font 'sans,10'\nset output '{}'\nset multiplot layout {},3\n"
      "set yrange [40:0]\nset xrange [0:60]\nset size ratio -1\nset palette rgbformulae 33,13,10\n{}",
      300 * rows, file.string(), rows, settings);
  for (const NamedImage& image : images) {
    script += "$image << EOD\n";
    for (std::size_t n = 0; n < image.values.size(); ++n) {
      if (n > 0 && n % g.nx == 0) script += "\n";
      script +=
          fmt::format("{:.4g} {:.4g} {:.4g}\n", 1e3 * (g.origin_x_m + static_cast<double>(n % g.nx) * g.dx_m),
                      1e3 * (g.origin_y_m + static_cast<double>(n / g.nx) * g.dy_m), scale * image.values[n]);
    }
    script += fmt::format("EOD\nset title '{}'\nplot $image using 1:2:3 with image notitle\n", image.title);
  }
  plot(file, script + "unset multiplot\n");
}

void draw_elastography(const ElastographyFigures& figures, const std::filesystem::path& folder) {
  for (const Factor& factor : kFactors) draw_factor(figures, factor, folder);
  draw_trades(figures, folder);
  draw_rigid(figures.rigid, folder / "elastography_rigid.png");
  draw_images(figures.images.grid, figures.images.strain, -100,
              "set cbrange [0:2]\nset cblabel 'compression (%)'\n", folder / "elastography_strain.png");
  draw_modulus(figures, folder);
}

}  // namespace teletact::bench
