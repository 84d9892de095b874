#include "bench/suites/law/cases.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <utility>
#include <vector>

#include "service/base/choices.h"
#include "service/contact/plane_touch_model.h"
#include "service/scene/tissue_models.h"

namespace teletact::bench {
namespace {

namespace choices = service::choices;
using Modulus = std::function<double(double x_m, double y_m)>;

constexpr double kWindowM = 0.06, kWidthM = 0.18, kCoarseMesh = 0.002;

// Uniform numbers that are the same with every standard library.
class Random {
 public:
  Random(std::uint64_t seed, std::size_t index) : engine_(seed * 1000003 + index) {}
  double uniform(double low, double high) { return low + (high - low) * double(engine_() >> 11) * 0x1p-53; }
  double log_uniform(double low, double high) { return std::exp(uniform(std::log(low), std::log(high))); }

 private:
  std::mt19937_64 engine_;
};

// Harmonic, as of a window.
double mean_modulus_pa(const Modulus& modulus, double x0, double x1, double y0, double y1) {
  constexpr int kEach = 4;
  double sum = 0;
  for (int i = 0; i < kEach; ++i)
    for (int j = 0; j < kEach; ++j)
      sum += 1 / modulus(x0 + (x1 - x0) * (i + 0.5) / kEach, y0 + (y1 - y0) * (j + 0.5) / kEach);
  return kEach * kEach / sum;
}

std::shared_ptr<const service::TouchModel> mesh(const Modulus& modulus, const service::SceneGeometry& g,
                                                const service::Region& window, double spacing_m) {
  const auto even = [&](double length_m) {
    return service::uniform_coordinates(0, length_m, std::size_t(std::llround(length_m / spacing_m)));
  };
  const bool product = spacing_m == choices::kFine;
  service::TissueGrid grid{
      product ? service::window_columns_m(g, window.begin_x_m, window.end_x_m) : even(g.width_m),
      product ? service::window_rows_m(g) : even(g.depth_m)};
  service::Material material{{}, g.poisson_ratio};
  for (std::size_t j = 0; j + 1 < grid.ny(); ++j)
    for (std::size_t i = 0; i + 1 < grid.nx(); ++i)
      material.youngs_modulus_pa.push_back(
          mean_modulus_pa(modulus, grid.x_m[i], grid.x_m[i + 1], grid.y_m[j], grid.y_m[j + 1]));
  service::TissueModelOptions options;
  const double reach_m = choices::kHandOver + choices::kWidestReach;
  if (product) {
    options.touch_begin_m = std::max(0.0, window.begin_x_m - reach_m);
    options.touch_end_m = std::min(g.width_m, window.end_x_m + reach_m);
  }
  options.thickness_m = g.thickness_m;
  return std::make_shared<const service::PlaneTouchModel>(std::make_shared<const service::TissueModel>(
      std::move(grid), std::move(material), g.supports, options));
}

// Round inclusions, and now and then a block with an upright side, that begin 3 to 20 mm below the layer.
Modulus inclusions(Random& random, const service::Region& window, double layer_m, double max_contrast,
                   std::string& name) {
  struct Round {
    double x_m, y_m, radius_m, contrast;
  };
  constexpr double kMaxRadiusM = 0.008;
  const double background_pa = random.log_uniform(5e3, 20e3);
  std::vector<Round> all(1 + std::size_t(random.uniform(0, 3)));
  double top_m = kWidthM;
  for (Round& r : all) {
    r.contrast = random.log_uniform(2, max_contrast);
    r.radius_m = random.uniform(0.002, kMaxRadiusM);
    r.x_m = random.uniform(window.begin_x_m - 0.005, window.end_x_m + 0.005);
    const double begins_m = random.uniform(0.003, 0.020);
    top_m = std::min(top_m, begins_m);
    r.y_m = layer_m + begins_m + r.radius_m;
  }
  all.front().contrast = max_contrast;
  const bool block = random.uniform(0, 1) < 0.2;
  const Round upright{random.uniform(window.begin_x_m, window.end_x_m),
                      layer_m + random.uniform(0.003, 0.020), 0, random.log_uniform(2, max_contrast)};
  name += fmt::format("{}{} of contrast {:.0f}, at {:.0f} mm", all.size(), block ? " + block" : "",
                      max_contrast, 1e3 * top_m);
  return [=](double x, double y) {
    double contrast = 1;
    for (const Round& r : all)
      if (std::hypot(x - r.x_m, y - r.y_m) < r.radius_m) contrast = r.contrast;
    if (block && x > upright.x_m && y > upright.y_m && y < upright.y_m + kMaxRadiusM)
      contrast = upright.contrast;
    return background_pa * contrast;
  };
}

// One whose curved half-contact at a light touch spans two nodes of the mesh at least.
service::Fingertip resolved_tip(Random& random, double spacing_m) {
  const double min_m = 4 * spacing_m * spacing_m / (2 * choices::kLightTouch);
  const double kind = random.uniform(0, 1);
  service::Fingertip tip;
  if (kind < 0.4) {
    tip.radius_m = std::max(tip.radius_m, min_m);
  } else if (kind < 0.65) {
    tip.radius_m = random.log_uniform(min_m, 4 * min_m);
  } else if (kind < 0.85) {
    tip.shape = service::FingertipShape::kFlatPunch;
    tip.radius_m = random.log_uniform(min_m, 2 * min_m);
    tip.half_width_m = random.uniform(0.002, 0.005);
  } else {
    tip.shape = service::FingertipShape::kNode;
    tip.footprint_m = random.uniform(spacing_m, 3 * spacing_m);
  }
  return tip;
}

service::Fingertip coarse_tip(Random& random) {
  service::Fingertip tip;
  tip.radius_m = random.log_uniform(0.001, 0.003);
  if (random.uniform(0, 1) < 0.3) tip.shape = service::FingertipShape::kFlatPunch;
  return tip;
}

std::string name_of(const service::Fingertip& tip) {
  if (tip.shape == service::FingertipShape::kNode)
    return fmt::format("Gaussian {:.1f}", 1e3 * tip.footprint_m);
  return fmt::format("{} {:.1f}", tip.shape == service::FingertipShape::kFlatPunch ? "punch" : "R",
                     1e3 * tip.radius_m);
}

}  // namespace

LawCase make_law_case(LawGroup group, std::uint64_t seed, std::size_t index) {
  Random random(seed + std::uint64_t(group), index);
  service::SceneGeometry g;
  g.width_m = kWidthM;
  g.depth_m = 0.002 * std::round(random.uniform(15, 30));
  const bool plain = group == LawGroup::kChecker || group == LawGroup::kCoarse;
  const double spacing_m = !plain && index % 10 == 7 ? kCoarseMesh : choices::kFine;
  LawCase c;
  c.deepest_m = group == LawGroup::kStuck ? 0.004 : 0.008;
  c.region.begin_x_m = index % 5 == 4 ? 0 : random.uniform(0.04, 0.08);
  c.region.end_x_m = c.region.begin_x_m + kWindowM;
  c.tip = group == LawGroup::kCoarse ? coarse_tip(random) : resolved_tip(random, spacing_m);
  if (group == LawGroup::kStuck) c.tip.friction = service::Friction::kStuck;
  c.layer.depth_m = !plain && index % 3 == 2 ? 0.002 * std::round(random.uniform(1, 5)) : 0;
  c.name = fmt::format("{}{}{}{}, ", name_of(c.tip), c.layer.depth_m > 0 ? ", inside" : "",
                       c.region.begin_x_m == 0 ? ", at the border" : "",
                       spacing_m == kCoarseMesh ? ", 2 mm mesh" : "");
  Modulus modulus;
  if (group == LawGroup::kChecker) {
    const double size_m = random.uniform(0.004, 0.010), shift_m = random.uniform(0, 0.02);
    c.name += fmt::format("checkerboard of {:.0f} mm", 1e3 * size_m);
    modulus = [=](double x, double y) {
      const bool hard = (int((x + shift_m) / size_m) + int(y / size_m)) % 2 != 0;
      return hard ? 100e3 : 10e3;
    };
  } else {
    modulus = inclusions(random, c.region, c.layer.depth_m, index % 2 ? 30 : 10, c.name);
  }
  c.model = mesh(modulus, g, c.region, spacing_m);
  const std::vector<service::Layer> layers = c.model->layers();
  c.layer = *std::min_element(layers.begin(), layers.end(), [&](const auto& one, const auto& other) {
    return std::abs(one.depth_m - c.layer.depth_m) < std::abs(other.depth_m - c.layer.depth_m);
  });
  return c;
}

}  // namespace teletact::bench
