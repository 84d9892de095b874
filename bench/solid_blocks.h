// The tissues of the solid chart: blocks 40 mm deep, of 10 kPa, with a lump, a texture or both; the period is
// 128 x 64 mm where nothing else is said.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "bench/rigid_contact.h"
#include "service/tissue/solid/solid_tissue.h"

namespace teletact::bench {

inline constexpr double kSolidModulusPa = 10e3, kSolidDepthM = 0.040;

// Rows grow by 3 % each.
service::SolidGrid solid_grid(std::size_t nx, std::size_t nz, std::size_t layers, double spacing_x_m,
                              double spacing_z_m);
service::SolidGrid solid_13k();   // in steps of 2 mm; the period is 64 x 64 mm
service::SolidGrid solid_70k();   // in steps of 2 mm
service::SolidGrid solid_336k();  // in steps of 1 mm

struct SolidLump {
  double contrast = 10;  // over the tissue around it
  // Of the middle of the block's surface: its centre. An element is in it by its own centre.
  std::array<double, 3> centre_m{0, 0.012, 0};
  double radius_m = 0.006;
};

// `texture`: deviation of ln E, drawn for each cube of 4 mm, whatever the mesh.
service::SolidTissue solid_tissue(const service::SolidGrid&, double poisson_ratio, const SolidLump&,
                                  double texture = 0, std::uint64_t seed = 1);

// 0.14 N with Hertz's pressure of radius 4 mm on the middle.
SurfaceValues hertz_load(const service::SolidGrid&);

}  // namespace teletact::bench
