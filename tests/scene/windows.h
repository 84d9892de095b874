// Windows for the scene tests: an image grid as elastography makes it, filled from a true modulus field.
#pragma once

#include <cmath>
#include <functional>

#include "service/contact/plane_touch_model.h"
#include "service/scene/scenes.h"

namespace teletact::service {

using TrueModulus = std::function<double(double x_m, double y_m)>;  // scene coordinates

inline TrueModulus homogeneous(double modulus_pa) {
  return [=](double, double) { return modulus_pa; };
}

inline TrueModulus inclusion(double background_pa, double contrast, double x_m, double y_m, double radius_m) {
  return [=](double x, double y) {
    return background_pa * (std::hypot(x - x_m, y - y_m) < radius_m ? contrast : 1);
  };
}

// 0.45 x 0.4 mm image nodes over [x, x + width) and 1 mm ... depth - 1 mm, all valid.
inline WindowEstimate window_of(const TrueModulus& truth, double window_x_m, double width_m, double depth_m) {
  WindowEstimate w;
  w.window_x_m = window_x_m;
  w.width_m = width_m;
  const double dx_m = 0.45e-3, dy_m = 0.4e-3;
  w.grid = {static_cast<std::size_t>(width_m / dx_m),
            static_cast<std::size_t>((depth_m - 2e-3) / dy_m),
            dx_m / 2,
            1e-3,
            dx_m,
            dy_m};
  for (std::size_t j = 0; j < w.grid.ny; ++j)
    for (std::size_t i = 0; i < w.grid.nx; ++i)
      w.youngs_modulus_pa.push_back(
          static_cast<float>(truth(window_x_m + w.grid.origin_x_m + dx_m * static_cast<double>(i),
                                   w.grid.origin_y_m + dy_m * static_cast<double>(j))));
  w.valid.assign(w.grid.size(), 1);
  return w;
}

inline SceneGeometry tissue(double width_m, double depth_m) {
  SceneGeometry g;
  g.width_m = width_m;
  g.depth_m = depth_m;
  return g;
}

// What a window of a plane scene is made of.
inline const TissueModel& tissue_of(const WindowModel& window) {
  return *window.model->made_of().plane;
}

inline std::shared_ptr<VersionCounter> versions() {
  return std::make_shared<VersionCounter>(nullptr);
}

// Of 10 kPa, given, 60 x 20 mm in so many columns and rows.
inline std::shared_ptr<Scene> given_scene(std::size_t columns, std::size_t rows) {
  return std::make_shared<Scene>(
      "s", tissue(0.06, 0.02),
      ExplicitModulus{uniform_coordinates(0, 0.06, columns), uniform_coordinates(0, 0.02, rows),
                      std::vector<double>(columns * rows, 1e4)},
      versions());
}

}  // namespace teletact::service
