// The paper's Fig. 16 (T6.3): stiffness felt along nine layers, from the natural surface to the one above the
// inclusion, through the service's own tissue model and contact.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "bench/curves.h"
#include "bench/suites/paper/paper.h"
#include "bench/suites/paper/tissue.h"
#include "service/contact/contact.h"
#include "service/tissue/tissue_model.h"

namespace teletact::bench {
namespace {

constexpr std::size_t kLayers = 9, kCentreColumn = 25, kSideColumn = 10;
constexpr double kIndentationM = 0.002;
constexpr double kTolerance = 0.005;

// Contrast of the nine layers by an independent solver, to the digits it printed (T6.3).
struct Expected {
  double poisson_ratio;
  std::array<double, kLayers> contrast;
};
constexpr std::array<Expected, 2> kExpected{
    {{0.49, {1.191, 1.207, 1.207, 1.209, 1.219, 1.230, 1.256, 1.487, 2.763}},
     {0.30, {1.209, 1.256, 1.268, 1.271, 1.267, 1.257, 1.253, 1.340, 2.984}}}};

struct LayerFigures {
  double depth_m = 0;
  std::vector<double> stiffness_n_m;
  double contrast = 0, expected_contrast = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(LayerFigures, depth_m, stiffness_n_m, contrast, expected_contrast)
struct CaseFigures {
  double poisson_ratio = 0;
  std::vector<double> x_m;
  std::vector<LayerFigures> layers{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(CaseFigures, poisson_ratio, x_m, layers)
struct Figures {
  double indentation_m = kIndentationM;
  std::vector<CaseFigures> cases{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, indentation_m, cases)

// Force over displacement of every node of the layer, one pressed at a time and free to move sideways.
std::vector<double> stiffness_n_m(const service::TissueModel& model, std::size_t layer) {
  const auto compliance = model.compliance(layer);
  const service::Fingertip node{.shape = service::FingertipShape::kNode};
  std::vector<double> stiffness;
  for (const double x_m : model.problem().grid.x_m) {
    const auto answer =
        service::solve_contact(model.problem(), layer, *compliance, node, {x_m, kIndentationM});
    stiffness.push_back(-answer.force_n[1] / kIndentationM);
  }
  return stiffness;
}

CaseFigures measure_at(const Expected& expected, Promises& promises) {
  const service::TissueModel model = paper_tissue(expected.poisson_ratio);
  CaseFigures out{expected.poisson_ratio, model.problem().grid.x_m};
  double worst = 0;
  std::printf("\nnu = %.2f: contrast, expected, layer\n", expected.poisson_ratio);
  for (std::size_t layer = 0; layer < kLayers; ++layer) {
    LayerFigures l{model.problem().grid.y_m[layer], stiffness_n_m(model, layer)};
    l.contrast = l.stiffness_n_m[kCentreColumn] / l.stiffness_n_m[kSideColumn];
    l.expected_contrast = expected.contrast[layer];
    const double error = std::abs(l.contrast / l.expected_contrast - 1);
    worst = error <= worst ? worst : error;  // NaN stays
    std::printf("  %.3f  %.3f  y = %.0f mm\n", l.contrast, l.expected_contrast, 1e3 * l.depth_m);
    out.layers.push_back(std::move(l));
  }
  promises.push_back(
      {snake_case(fmt::format("contrast of nine layers off the expected at poisson ratio {:.2f}",
                              expected.poisson_ratio)),
       worst, kTolerance});
  return out;
}

Figures measure(bool, Promises& promises) {
  Figures figures;
  for (const Expected& expected : kExpected) figures.cases.push_back(measure_at(expected, promises));
  return figures;
}

// The paper's form: stiffness along the surface for the nine layers, over the largest of all.
void draw_layers(const CaseFigures& one, const std::filesystem::path& file) {
  double largest = 0;
  std::vector<Curve> curves;
  for (const LayerFigures& layer : one.layers)
    for (const double stiffness : layer.stiffness_n_m) largest = std::max(largest, stiffness);
  for (const LayerFigures& layer : one.layers) {
    curves.push_back({.title = fmt::format("y = {:.0f} mm", 1e3 * layer.depth_m),
                      .style = fmt::format("lines lw 2 lc palette frac {:.3f}",
                                           static_cast<double>(curves.size()) / kLayers)});
    for (std::size_t i = 0; i < one.x_m.size(); ++i)
      curves.back().add(1e3 * one.x_m[i], layer.stiffness_n_m[i] / largest);
  }
  plot(file, script_of(curves,
                       "set yrange [0:1.05]\nset key outside right\nunset colorbox\n"
                       "set palette defined (0 '#bcd6ee', 1 '#08306b')\n" +
                           axes(fmt::format("Touching under the surface (the paper's Fig. 16), nu = "
                                            "{:.2f}\\nof its curves the paper states no figures",
                                            one.poisson_ratio),
                                "x (mm)", "stiffness over the largest")));
}

void draw_contrast(const Figures& figures, const std::filesystem::path& file) {
  std::vector<Curve> curves;
  for (const CaseFigures& one : figures.cases) {
    const std::size_t colour = curves.size() / 2 + 1;
    Curve found{.title = fmt::format("teletact, nu = {:.2f}", one.poisson_ratio),
                .style = fmt::format("lines lw 2 lc {}", colour)},
        expected{.title = fmt::format("expected, nu = {:.2f}", one.poisson_ratio),
                 .style = fmt::format("points pt 6 ps 1.6 lc {}", colour)};
    for (const LayerFigures& layer : one.layers) {
      found.add(1e3 * layer.depth_m, layer.contrast);
      expected.add(1e3 * layer.depth_m, layer.expected_contrast);
    }
    curves.insert(curves.end(), {found, expected});
  }
  plot(file,
       script_of(curves, "set key top left\n" +
                             axes("How far the inclusion stands out, against the depth of the touched "
                                  "layer\\nexpected: an independent solver's; the paper states no figures: "
                                  "'the closer ... the bigger'",
                                  "depth of the touched layer (mm)",
                                  "stiffness at the centre over that 30 mm beside it")));
}

void draw(const Figures& figures, const std::filesystem::path& folder) {
  for (const CaseFigures& one : figures.cases)
    draw_layers(one, folder / fmt::format("fig16_nu{:03.0f}.png", 100 * one.poisson_ratio));
  draw_contrast(figures, folder / "fig16_contrast.png");
}

}  // namespace

Part paper_fig16() {
  return make_part("fig16", measure, draw);
}

}  // namespace teletact::bench
