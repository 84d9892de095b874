#include "client/link/tactile_image.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace teletact::client {
namespace {

// False: malformed.
bool read_taxels(const v1::Array& in, const TactileImage& image, std::vector<float>& out) {
  const std::size_t taxels = image.along_x * image.along_z;
  if (in.dtype() != v1::DATA_TYPE_FLOAT32 || in.shape_size() != 2 || in.shape(0) != image.along_z ||
      in.shape(1) != image.along_x || in.data().size() != taxels * sizeof(float))
    return false;
  out.resize(taxels);
  std::memcpy(out.data(), in.data().data(), in.data().size());
  return std::all_of(out.begin(), out.end(), [](float value) { return std::isfinite(value); });
}

}  // namespace

std::optional<TactileImage> tactile_from(const v1::TactileImage& in) {
  constexpr std::uint32_t kMaxTaxels = 1024;  // a side
  TactileImage out;
  const v1::Array& pressure = in.pressure_pa();
  if (in.centre_m_size() != 3 || pressure.shape_size() != 2) return std::nullopt;
  for (const std::uint32_t size : pressure.shape())
    if (size < 1 || size > kMaxTaxels) return std::nullopt;
  out.sequence = in.sequence();
  out.along_z = pressure.shape(0);
  out.along_x = pressure.shape(1);
  out.pitch_m = in.pitch_m();
  out.begin_x_m = in.centre_m(0) - out.pitch_m * (static_cast<double>(out.along_x) - 1) / 2;
  out.begin_z_m = in.centre_m(2) - out.pitch_m * (static_cast<double>(out.along_z) - 1) / 2;
  out.force_n = in.force_n();
  out.outside_n = in.outside_n();
  const bool finite = std::isfinite(out.begin_x_m) && std::isfinite(out.begin_z_m) &&
                      std::isfinite(out.force_n) && std::isfinite(out.outside_n);
  if (!finite || !(out.pitch_m > 0) || !read_taxels(pressure, out, out.pressure_pa)) return std::nullopt;
  if (in.has_beyond_homogeneous_pa() && !read_taxels(in.beyond_homogeneous_pa(), out, out.beyond_pa))
    return std::nullopt;
  return out;
}

}  // namespace teletact::client
