// proto <-> domain for scenes. Everything that comes in is checked before anything is allocated for
// it; std::invalid_argument names the field as the contract does and says what to do.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

#include "service/imaging/tracking/frame.h"
#include "service/scene/scene.h"
#include "service/scene/slices.h"
#include "service/touch_plane/touch_stream.h"
#include "teletact/v1/common.pb.h"
#include "teletact/v1/palpation.pb.h"

namespace teletact::service {

namespace v1 = ::teletact::v1;

// The uniform cells on which a scene is shown, by their centres, in scene coordinates. Index i + nx j of the
// grid's nodes, the cells' centres.
struct CellView {
  static constexpr std::size_t kCellBytes = 2 * sizeof(float) + 1;
  ImageGrid grid;
  std::vector<float> modulus_pa;     // 0 where nothing was published
  std::vector<float> log_deviation;  // standard deviation of ln E; NaN where not known
  std::vector<std::uint8_t> valid;   // 1 where measured
};

// All of a scene's cells.
ImageGrid cells_of(const SceneSnapshot&, const SceneGeometry&);
// Those of columns [begin, end). Where the modulus was given, each shows the element that its centre lies in;
// of a solid, in the slice nearest to the middle.
CellView view_of(const SceneSnapshot&, const SceneGeometry&, std::size_t begin = 0,
                 std::size_t end = std::numeric_limits<std::size_t>::max());

// Of a table with the contract's enumerator for each of ours: the one that stands for `value` ...
template <class Table, class Ours>
auto message_of(const Table& table, Ours value) {
  return table.at(static_cast<std::size_t>(value));
}
// ... and the other way; throws std::invalid_argument, `unknown`, for what is not in the table.
template <class Ours, class Table, class Theirs>
Ours value_from(const Table& table, Theirs in, const char* unknown) {
  const auto found = std::ranges::find(table, in);
  if (found == table.end()) throw std::invalid_argument(unknown);
  return static_cast<Ours>(found - table.begin());
}

// A map of a scene or an estimate as a message. `values`: one for each node of the grid.
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

SceneGeometry geometry_from(const v1::SceneGeometry&, const Limits&);
// Of the message that scene_to() makes, and what it is made of meanwhile.
std::uint64_t scene_bytes(const Scene&, v1::SceneView);
// `instance`: the process', for stamps.
void scene_to(const Scene&, v1::SceneView, std::uint64_t instance, v1::Scene*);

// CLOCK_MONOTONIC of the process `instance`.
void stamp_to(std::int64_t monotonic_ns, std::uint64_t instance, v1::Stamp*);
void region_to(const Region&, v1::Region*);
void layer_to(const Layer&, v1::Layer*);
// [x, y] or [x, y, z]; what is absent is zero. Throws std::invalid_argument.
std::array<double, 3> vector_from(const char* field, const google::protobuf::RepeatedField<double>&,
                                  bool may_be_empty);
// Where a pose begins that lies along the scene's own axes; `what` it is of, for who is told that it must.
std::array<double, 3> origin_along_axes(const std::string& field, const v1::SlicePose&, const char* what);

std::size_t bytes_per_item(v1::DataType);
// None: the scene begins empty. Beyond the limits' elements Error(kExhausted), before the values are read.
std::optional<ExplicitModulus> modulus_from(const v1::CreateSceneRequest&, const Limits&);
// `field`: where it stands in its message; of which solid it is.
ModulusSlice slice_from(const std::string& field, const v1::ModulusSlice&, const ExplicitModulus& solid);

}  // namespace teletact::service
