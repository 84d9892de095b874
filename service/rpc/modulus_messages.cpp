#include "service/rpc/modulus_messages.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <stdexcept>

#include "service/rpc/palpation_messages.h"
#include "service/scene/errors.h"

namespace teletact::service {

std::size_t bytes_per_item(v1::DataType dtype) {
  switch (dtype) {
    case v1::DATA_TYPE_INT16:
      return 2;
    case v1::DATA_TYPE_FLOAT32:
      return 4;
    case v1::DATA_TYPE_FLOAT64:
      return 8;
    case v1::DATA_TYPE_UINT8:
      return 1;
    default:
      return 0;
  }
}

namespace {

// Product of the shape, checked against the bytes and the dtype's size.
std::size_t checked_items(const std::string& field, const v1::Array& array) {
  const std::size_t item = bytes_per_item(array.dtype());
  if (item == 0)
    throw std::invalid_argument(
        fmt::format("{}.dtype: unspecified; state how the bytes are to be read", field));
  unsigned __int128 items = 1;
  for (const std::uint32_t size : array.shape()) {
    items *= size;
    if (items > array.data().size()) break;
  }
  if (array.shape().empty() || items * item != array.data().size())
    throw std::invalid_argument(
        fmt::format("{}.data: {} bytes do not fill its shape; send product(shape) x {} bytes", field,
                    array.data().size(), item));
  return static_cast<std::size_t>(items);
}

// Of this shape.
std::vector<double> values_from(const std::string& field, const v1::Array& in,
                                const std::vector<std::size_t>& wanted) {
  if (!std::equal(in.shape().begin(), in.shape().end(), wanted.begin(), wanted.end()))
    throw std::invalid_argument(fmt::format("{}.shape: must be [{}len(y_m) - 1, len(x_m) - 1] = [{}]", field,
                                            wanted.size() > 2 ? "len(z_m) - 1, " : "",
                                            fmt::join(wanted, ", ")));
  const std::size_t items = checked_items(field, in);
  std::vector<double> out(items);
  if (in.dtype() == v1::DATA_TYPE_FLOAT64) {
    std::memcpy(out.data(), in.data().data(), items * sizeof(double));
  } else if (in.dtype() == v1::DATA_TYPE_FLOAT32) {
    for (std::size_t n = 0; n < items; ++n) {
      float value = 0;
      std::memcpy(&value, in.data().data() + n * sizeof(float), sizeof(float));
      out[n] = value;
    }
  } else {
    throw std::invalid_argument(field + ".dtype: must be FLOAT32 or FLOAT64");
  }
  return out;
}

std::size_t intervals(int nodes) {
  return static_cast<std::size_t>(nodes) - 1;
}

// Its nodes alone.
ExplicitModulus grid_from(const v1::ModulusMap& in) {
  if (in.x_m_size() < 2 || in.y_m_size() < 2)
    throw std::invalid_argument("modulus.x_m, modulus.y_m: give at least 2 node coordinates each");
  if (in.z_m_size() == 1)
    throw std::invalid_argument("modulus.z_m: give at least 2 node coordinates, or none for a plane scene");
  ExplicitModulus e;
  e.x_m.assign(in.x_m().begin(), in.x_m().end());
  e.y_m.assign(in.y_m().begin(), in.y_m().end());
  e.z_m.assign(in.z_m().begin(), in.z_m().end());
  return e;
}

ExplicitModulus modulus_from(const v1::ModulusMap& in, const Limits& limits) {
  ExplicitModulus e = grid_from(in);
  const std::size_t max_elements = e.solid() ? limits.max_solid_elements : limits.max_scene_elements;
  const std::size_t columns = intervals(in.x_m_size()), rows = intervals(in.y_m_size()), slices = e.slices();
  if (rows > max_elements / columns || slices > max_elements / columns / rows)
    throw Error(ErrorKind::kExhausted,
                fmt::format("modulus: {} x {} x {} elements, at most {} are allowed; use a coarser grid",
                            columns, rows, slices, max_elements));
  std::vector<std::size_t> shape{rows, columns};
  if (e.solid()) shape.insert(shape.begin(), slices);
  e.youngs_modulus_pa = values_from("modulus.youngs_modulus_pa", in.youngs_modulus_pa(), shape);
  return e;
}

}  // namespace

std::optional<ExplicitModulus> modulus_from(const v1::CreateSceneRequest& in, const Limits& limits) {
  if (in.slices().empty())
    return in.has_modulus() ? std::optional(modulus_from(in.modulus(), limits)) : std::nullopt;
  ExplicitModulus grid = grid_from(in.modulus());
  if (!grid.solid())
    throw std::invalid_argument("modulus.z_m: none; slices need the nodes of the solid that they are of");
  if (in.modulus().has_youngs_modulus_pa())
    throw std::invalid_argument(
        "modulus.youngs_modulus_pa: the slices say it; leave it out, or leave the slices out");
  std::vector<ModulusSlice> slices;
  for (const v1::ModulusSlice& slice : in.slices())
    slices.push_back(slice_from(fmt::format("slices[{}]", slices.size()), slice, grid));
  return stacked(std::move(grid), slices, limits);
}

ModulusSlice slice_from(const std::string& field, const v1::ModulusSlice& in, const ExplicitModulus& solid) {
  const auto lies_along = [&](const char* name, const auto& stated, const std::array<double, 3>& axis) {
    const std::string full = field + ".pose." + name;
    if (!stated.empty() && vector_from(full.c_str(), stated, false) != axis)
      throw std::invalid_argument(full + ": slices lie along the scene's own axes; leave it out");
  };
  lies_along("lateral", in.pose().lateral(), {1, 0, 0});
  lies_along("axial", in.pose().axial(), {0, 1, 0});
  const std::string origin = field + ".pose.origin_m";
  if (in.pose().origin_m_size() != 3) throw std::invalid_argument(origin + ": give [0, 0, z]");
  const auto origin_m = vector_from(origin.c_str(), in.pose().origin_m(), false);
  for (const std::size_t axis : {0U, 1U})
    if (origin_m[axis] != 0)
      throw std::invalid_argument(fmt::format("{}[{}]: {}; slices are of the whole plane: give [0, 0, z]",
                                              origin, axis, origin_m[axis]));
  const v1::ModulusMap& map = in.modulus();
  if (!map.z_m().empty())
    throw std::invalid_argument(field + ".modulus.z_m: a slice has none; its z is pose.origin_m[2]");
  ModulusSlice slice;
  slice.z_m = origin_m[2];
  slice.x_m.assign(map.x_m().begin(), map.x_m().end());
  slice.y_m.assign(map.y_m().begin(), map.y_m().end());
  slice.youngs_modulus_pa = values_from(field + ".modulus.youngs_modulus_pa", map.youngs_modulus_pa(),
                                        {solid.y_m.size() - 1, solid.x_m.size() - 1});
  if (in.has_youngs_modulus_log_std())
    slice.log_deviation = values_from(field + ".youngs_modulus_log_std", in.youngs_modulus_log_std(),
                                      {solid.y_m.size() - 1, solid.x_m.size() - 1});
  return slice;
}

}  // namespace teletact::service
