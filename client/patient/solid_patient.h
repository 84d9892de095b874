// A simulated solid patient whose modulus is known everywhere: layers that change with depth, and two stiff
// lumps. Held at its bottom, touched on its surface; x, y, z as in theory (Axes).
#pragma once

#include <array>
#include <cstdint>

#include "client/files/metaimage.h"

namespace teletact::client {

// A ball, stiffer than the tissue around it; all of `contrast` inside its radius less half of the border.
struct Lump {
  double x_m = 0, y_m = 0, z_m = 0;  // centre
  double radius_m = 0;
  double contrast = 1;
};

struct SolidPatient {
  // Modulus and lumps change over so much, ln E by a straight line: no grid shows a border sharper than
  // itself.
  static constexpr double kBorderM = 0.002;
  static constexpr double kWidthM = 0.112, kDepthM = 0.040, kEndM = 0.024;  // z from -kEndM to kEndM
  static constexpr double kPoissonRatio = 0.49;
  // Elements that it is published in: planes 2 mm apart.
  static constexpr std::array<double, 3> kElementsM{0.002, 0.001, 0.002};

  std::array<double, 3> layers_pa{};  // from above
  std::array<double, 2> borders_m{};  // depths between them
  std::array<Lump, 2> lumps{};

  // Young's modulus (Pa) anywhere: beyond the ends along x and z the layers go on.
  double modulus_pa(double x_m, double y_m, double z_m) const;
  // Of the layers alone.
  double layered_pa(double y_m) const;
};

// The same seed gives the same patient: lumps of 9 to 13 mm and contrast 3 to 6, 2 to 6 mm below the surface,
// one in each half along x, to different sides of z = 0.
SolidPatient random_solid_patient(std::uint64_t seed);

// A stack of plane maps of modulus, Pa: float, [z][y][x], of elements of such sides, each that of its middle.
MetaImage modulus_volume(const SolidPatient& patient,
                         const std::array<double, 3>& spacing_m = SolidPatient::kElementsM);

}  // namespace teletact::client
