// T3.0: the field's first answer, Ophir, Cespedes, Ponnekanti, Yazdi, Li 1991, "Elastography: a quantitative
// method for imaging the elasticity of biological tissues", Ultrason. Imaging 13:111-134,
// doi 10.1177/016173469101300201: stress is taken to be uniform.
#include <algorithm>
#include <cmath>
#include <limits>

#include "bench/basics/median.h"
#include "bench/peers/modulus_peer.h"

namespace teletact::bench {
namespace {

constexpr double kMinStrain = 2e-4;  // ours says nothing below that either
constexpr std::ptrdiff_t kMedianRadius = 2;

// Of the finite values around; NaN stays NaN.
std::vector<float> median(const std::vector<float>& raw, std::ptrdiff_t nx, std::ptrdiff_t ny) {
  std::vector<float> out = raw;
  for (std::ptrdiff_t j = 0; j < ny; ++j)
    for (std::ptrdiff_t i = 0; i < nx; ++i) {
      if (!std::isfinite(raw[static_cast<std::size_t>(i + nx * j)])) continue;
      std::vector<float> around;
      for (auto r = std::max<std::ptrdiff_t>(0, j - kMedianRadius); r <= std::min(ny - 1, j + kMedianRadius);
           ++r)
        for (auto c = std::max<std::ptrdiff_t>(0, i - kMedianRadius);
             c <= std::min(nx - 1, i + kMedianRadius); ++c)
          if (const float v = raw[static_cast<std::size_t>(c + nx * r)]; std::isfinite(v))
            around.push_back(v);
      out[static_cast<std::size_t>(i + nx * j)] = median_of(std::move(around));
    }
  return out;
}

std::vector<float> by_inverse_strain(const ModulusProblem& p) {
  const double pressure_pa = p.force.force_n / p.force.contact_area_m2;
  std::vector<float> raw(p.strain.size(), std::numeric_limits<float>::quiet_NaN());
  for (std::size_t n = 0; n < raw.size(); ++n)
    if (-p.strain[n] >= kMinStrain) raw[n] = static_cast<float>(-pressure_pa / p.strain[n]);
  return median(raw, static_cast<std::ptrdiff_t>(p.track.grid.nx),
                static_cast<std::ptrdiff_t>(p.track.grid.ny));
}

}  // namespace

ModulusPeer make_inverse_strain() {
  return {"1/strain", by_inverse_strain};
}

}  // namespace teletact::bench
