// A second kind of model behind the seam: a rounded tip on an elastic half-space (Hertz), in closed form and
// in three dimensions. Its surface is tilted, so that force and tangent have all components.
//   U = 8/15 E* sqrt(R) d^(5/2),  E* = E / (1 - nu^2),  d = n . p the indentation along the normal n
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "service/contact/fingertip.h"
#include "service/scene/touch_models.h"

namespace teletact::service {

// Through the scene's origin.
inline Layer tilted_surface() {
  const double length = std::sqrt(0.1 * 0.1 + 0.95 * 0.95 + 0.25 * 0.25);
  return {0, {0.1 / length, 0.95 / length, 0.25 / length}};
}

// The position over x and z that is so deep.
inline Vector3 on_tilted_surface(double x_m, double z_m, double indentation_m) {
  const Vector3 n = tilted_surface().normal;
  return {x_m, (indentation_m - n[0] * x_m - n[2] * z_m) / n[1], z_m};
}

// Throws std::invalid_argument for what has no closed form here.
inline void check_tip(const Fingertip& tip) {
  validate(tip);
  if (tip.shape != FingertipShape::kRoundedTip || tip.friction != Friction::kFrictionless)
    throw std::invalid_argument(
        "open.fingertip.shape: a half-space is touched by frictionless rounded tips alone; use one");
}

struct HalfSpaceFaults {
  double stated_error = 8 * std::numeric_limits<double>::epsilon();  // that its forces state, relative
  void (*ahead)() = [] {};                                           // when the finger's way is made ready
};

class HalfSpace final : public TouchModel {
 public:
  HalfSpace(double youngs_modulus_pa, double poisson_ratio, Region region, MemoryAccount account = {},
            const HalfSpaceFaults& faults = {})
      : TouchModel(std::move(account)),
        modulus_pa_(youngs_modulus_pa / (1 - poisson_ratio * poisson_ratio)),
        faults_(faults),
        region_(region) {}
  Region region() const override { return region_; }
  std::vector<Layer> layers() const override { return {tilted_surface()}; }
  std::shared_ptr<TouchedLayer> layer(const Layer& layer, const TouchWay&, const TouchWork&) const override {
    if (layer != tilted_surface()) throw std::out_of_range("a half-space has its surface alone");
    return std::make_shared<Surface>(modulus_pa_, faults_);
  }

 private:
  class Surface final : public TouchedLayer {
   public:
    Surface(double modulus_pa, const HalfSpaceFaults& faults) : modulus_pa_(modulus_pa), faults_(faults) {}
    std::optional<TouchJob> wanted(const Fingertip&, const TouchPose&, double around_m) override {
      if (around_m > 0) faults_.ahead();
      return std::nullopt;
    }
    ContactAnswer answer(const Fingertip& tip, const TouchPose& pose) override {
      check_tip(tip);
      const Layer surface = tilted_surface();
      const double d = indentation_m(surface, pose);
      ContactAnswer answer;
      answer.solve.reason = "closed form";  // and `path` stays kAuto: it has no other way
      answer.solve.relative_error = faults_.stated_error;
      if (d <= 0) return answer;
      const double stiffness = modulus_pa_ * std::sqrt(tip.radius_m * d);  // half of dF/dd
      answer.state = ContactState::kContact;
      answer.energy_j = 8.0 / 15 * stiffness * d * d;
      for (std::size_t i = 0; i < 3; ++i) {
        answer.force_n[i] = -4.0 / 3 * stiffness * d * surface.normal[i];
        for (std::size_t j = 0; j < 3; ++j)
          answer.tangent_n_m[3 * i + j] = -2 * stiffness * surface.normal[i] * surface.normal[j];
      }
      return answer;
    }

   private:
    const double modulus_pa_;
    const HalfSpaceFaults faults_;
  };
  const double modulus_pa_;
  const HalfSpaceFaults faults_;
  const Region region_;
};

// Every window is a half-space of its mean modulus.
class HalfSpaces final : public TouchModels {
 public:
  explicit HalfSpaces(const HalfSpaceFaults& faults = {}) : faults_(faults) {}
  std::vector<Layer> layers(const SceneGeometry&) const override { return {tilted_surface()}; }
  double context_m() const override { return 0; }
  void check(bool /*solid*/, const Fingertip& tip, const Layer&, const TouchWay& way) const override {
    check_tip(tip);
    if (way.path != SolvePath::kAuto)
      throw std::invalid_argument("open.path: a half-space has its closed form alone; leave the path out");
  }
  std::shared_ptr<const TouchModel> of_window(const WantedModel& w) const override {
    const double modulus_pa =
        w.map.mean_modulus_pa(w.region.begin_x_m, w.region.end_x_m, 0, w.geometry.depth_m);
    return std::make_shared<const HalfSpace>(modulus_pa, w.geometry.poisson_ratio, w.region, w.account,
                                             faults_);
  }
  std::shared_ptr<const TouchModel> of_modulus(const SceneGeometry& geometry, const ExplicitModulus& e,
                                               const MemoryAccount& account) const override {
    if (geometry.supports != Supports{})
      throw std::invalid_argument("geometry.supports: a half-space has no edges to hold; leave them out");
    const Region whole{0, std::nextafter(geometry.width_m, HUGE_VAL)};  // its end belongs to it
    return std::make_shared<const HalfSpace>(e.youngs_modulus_pa.front(), geometry.poisson_ratio, whole,
                                             account, faults_);
  }

 private:
  const HalfSpaceFaults faults_;
};

}  // namespace teletact::service
