// A map of a scene or an estimate as a message.
#pragma once

#include <cstdint>
#include <type_traits>
#include <vector>

#include "service/imaging/tracking/frame.h"
#include "teletact/v1/common.pb.h"

namespace teletact::service {

// `values`: one for each node of the grid.
template <class T>
void map_to(const char* name, const char* unit, const ImageGrid& in, const std::vector<T>& values,
            ::teletact::v1::Map* out) {
  static_assert(std::is_same_v<T, float> || std::is_same_v<T, std::uint8_t>);
  const auto nx = static_cast<std::uint32_t>(in.nx), ny = static_cast<std::uint32_t>(in.ny);
  out->set_name(name);
  out->set_unit(unit);
  auto* grid = out->mutable_grid();
  grid->add_size(nx), grid->add_size(ny);
  grid->add_origin_m(in.origin_x_m), grid->add_origin_m(in.origin_y_m);
  grid->add_spacing_m(in.dx_m), grid->add_spacing_m(in.dy_m);
  auto* array = out->mutable_values();
  array->set_dtype(sizeof(T) == 1 ? ::teletact::v1::DATA_TYPE_UINT8 : ::teletact::v1::DATA_TYPE_FLOAT32);
  array->add_shape(ny), array->add_shape(nx);
  array->set_data(values.data(), values.size() * sizeof(T));
}

}  // namespace teletact::service
