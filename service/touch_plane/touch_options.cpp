#include "service/touch_plane/touch_options.h"

#include <fmt/format.h>

#include <cmath>
#include <stdexcept>
#include <utility>

namespace teletact::service {
namespace {

void check_fingertip(const Fingertip& tip, bool solid, const Limits& limits) {
  const auto check_length = [&](const char* field, double value_m, double min_m) {
    if (value_m >= min_m && value_m <= limits.max_tip_m) return;
    throw std::invalid_argument(fmt::format("{}: {} m is not within [{}, {}]; a fingertip has about 0.008 m",
                                            field, value_m, min_m, limits.max_tip_m));
  };
  const auto require_solid = [solid](const char* what) {
    if (solid) return;
    throw std::invalid_argument(
        fmt::format("open.fingertip.shape: {} touches solid tissue (CreateScene with modulus.z_m); touch a "
                    "plane scene with a flat punch or a rounded tip",
                    what));
  };
  switch (tip.shape) {
    case FingertipShape::kNode:
      // A Gaussian is cut at three standard deviations or so.
      if (!(tip.footprint_m >= 0 && 3 * tip.footprint_m <= limits.max_tip_m))
        throw std::invalid_argument(
            fmt::format("open.fingertip.footprint_m: {} m is not within [0, {}]; "
                        "0.001 m is smooth between nodes",
                        tip.footprint_m, limits.max_tip_m / 3));
      return;
    case FingertipShape::kPad:
      require_solid("a pad");
      [[fallthrough]];
    case FingertipShape::kFlatPunch:
      check_length("open.fingertip.half_width_m", tip.half_width_m, limits.min_tip_m);
      check_length("open.fingertip.radius_m", tip.radius_m, 0);
      return;
    case FingertipShape::kSphere:
      require_solid("a sphere");
      [[fallthrough]];
    case FingertipShape::kRoundedTip:
      check_length("open.fingertip.radius_m", tip.radius_m, limits.min_tip_m);
      return;
  }
}

void check_path(const TouchOptions& options, bool shares) {
  if (options.path != SolvePath::kShares || (shares && !options.pressure)) return;
  throw std::invalid_argument(
      "open.path: SHARES is a closed form of a frictionless ROUNDED_TIP or SPHERE on a solid's surface, "
      "without pressures or tactile images; leave the path out");
}

void check_normal(const Vector3& asked, const Layer& layer) {
  constexpr double kRounding = 1e-6;
  for (std::size_t i = 0; i < asked.size(); ++i)
    if (!(std::abs(asked[i] - layer.normal[i]) <= kRounding))
      throw std::invalid_argument(
          fmt::format("open.layer.normal: [{:.4g}] is not this layer's, which is [{:.4g}]; leave it out",
                      fmt::join(asked, ", "), fmt::join(layer.normal, ", ")));
}

Fingertip canonical(Fingertip tip) {
  const Fingertip usual;
  const bool flat = tip.shape == FingertipShape::kFlatPunch || tip.shape == FingertipShape::kPad;
  if (!flat) tip.half_width_m = usual.half_width_m;
  if (tip.shape != FingertipShape::kPad) tip.pad_m_pa = usual.pad_m_pa;
  if (tip.shape != FingertipShape::kNode) tip.footprint_m = usual.footprint_m;
  if (tip.shape == FingertipShape::kNode) tip.radius_m = usual.radius_m;
  return tip;
}

}  // namespace

TouchOptions canonical(TouchOptions options) {
  options.fingertip = canonical(options.fingertip);
  return options;
}

bool has_shares(const TouchOptions& options, const Layer& layer, bool solid) {
  return solid && layer == Layer{} && round_and_frictionless(options.fingertip);
}

void check(const TouchOptions& options, const Layer& layer, bool solid, const Limits& limits) {
  check_fingertip(options.fingertip, solid, limits);
  check_path(options, has_shares(options, layer, solid));
  if (options.layer_normal) check_normal(*options.layer_normal, layer);
}

}  // namespace teletact::service
