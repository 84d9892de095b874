#include "service/rpc/palpation_messages.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <stdexcept>

#include "service/rpc/core.h"
#include "service/scene/errors.h"

namespace teletact::service {

namespace {

std::size_t slice_in_the_middle(const ExplicitModulus& e) {
  if (!e.solid()) return 0;
  const double middle_m = (e.z_m.front() + e.z_m.back()) / 2;
  std::size_t nearest = 0;
  for (std::size_t n = 1; n < e.slices(); ++n)
    if (std::abs(e.slice_m(n) - middle_m) < std::abs(e.slice_m(nearest) - middle_m)) nearest = n;
  return nearest;
}

std::size_t element_at(const std::vector<double>& nodes_m, double at_m) {
  const auto after = std::upper_bound(nodes_m.begin() + 1, nodes_m.end() - 1, at_m);
  return static_cast<std::size_t>(after - nodes_m.begin()) - 1;
}

void add(const Cell& cell, CellView& out) {
  out.modulus_pa.push_back(cell.modulus_pa);
  out.log_deviation.push_back(cell.log_deviation);
  out.valid.push_back(cell.state == CellState::kMeasured);
}

}  // namespace

ImageGrid cells_of(const SceneSnapshot& snapshot, const SceneGeometry& geometry) {
  const auto of = [](const StitchedMap& map) -> ImageGrid {
    return {map.nx(), map.ny(), map.cell_x_m() / 2, map.cell_y_m() / 2, map.cell_x_m(), map.cell_y_m()};
  };
  return snapshot.map ? of(*snapshot.map) : of(StitchedMap(geometry));
}

CellView view_of(const SceneSnapshot& snapshot, const SceneGeometry& geometry, std::size_t begin,
                 std::size_t end) {
  CellView view{cells_of(snapshot, geometry), {}, {}, {}};
  ImageGrid& grid = view.grid;
  end = std::min(end, grid.nx);
  grid.origin_x_m += grid.dx_m * static_cast<double>(begin);
  grid.nx = end - begin;
  const auto each = [&](const auto& cell_at) {
    for (std::size_t j = 0; j < grid.ny; ++j)
      for (std::size_t i = begin; i < end; ++i) add(cell_at(i, j), view);
  };
  if (!snapshot.modulus) {
    each([&](std::size_t i, std::size_t j) { return snapshot.map->cells().at(i, j); });
    return view;
  }
  const ExplicitModulus& e = *snapshot.modulus;
  const std::size_t first = slice_in_the_middle(e) * (e.x_m.size() - 1) * (e.y_m.size() - 1);
  each([&](std::size_t i, std::size_t j) -> Cell {
    const auto middle_m = [](std::size_t n, double step_m) {
      return (static_cast<double>(n) + 0.5) * step_m;
    };
    const std::size_t n = first + element_at(e.x_m, middle_m(i, grid.dx_m)) +
                          (e.x_m.size() - 1) * element_at(e.y_m, middle_m(j, grid.dy_m));
    return {static_cast<float>(e.youngs_modulus_pa[n]), CellState::kMeasured,
            e.log_deviation.empty() ? 0 : static_cast<float>(e.log_deviation[n])};
  });
  return view;
}

namespace {

[[noreturn]] void refuse_solid(const std::string& field, const char* remedy) {
  throw std::invalid_argument(field + ": solids are not supported yet; " + remedy);
}

EdgeSupport support_of(bool held) {
  return held ? EdgeSupport::kFixed : EdgeSupport::kFree;
}

// Nothing said: the bottom alone.
Supports supports_from(const v1::SceneGeometry& in) {
  if (!in.has_supports()) return {};
  const v1::Supports& s = in.supports();
  if (s.z_min() || s.z_max())
    refuse_solid(s.z_min() ? "geometry.supports.z_min" : "geometry.supports.z_max",
                 "a plane scene has no such face: leave it out");
  return {support_of(s.surface()), support_of(s.bottom()), support_of(s.x_min()), support_of(s.x_max())};
}

}  // namespace

SceneGeometry geometry_from(const v1::SceneGeometry& in, const Limits& limits) {
  if (in.size_m_size() == 3)
    refuse_solid("geometry.size_m[2]", "give [width, depth] of a plane scene, and thickness_m");
  if (in.size_m_size() != 2)
    throw std::invalid_argument(fmt::format(
        "geometry.size_m: {} values, this service models [width, depth]; give two", in.size_m_size()));
  SceneGeometry g;
  g.width_m = in.size_m(0);
  g.depth_m = in.size_m(1);
  if (in.has_poisson_ratio() || in.poisson_ratio() != 0) g.poisson_ratio = in.poisson_ratio();
  if (in.thickness_m() != 0) g.thickness_m = in.thickness_m();
  g.supports = supports_from(in);
  g.linear = in.linear();
  validate(g, limits);
  return g;
}

namespace {

void geometry_to(const SceneGeometry& g, v1::SceneGeometry* out) {
  const auto fixed = [](EdgeSupport e) { return e == EdgeSupport::kFixed; };
  out->add_size_m(g.width_m);
  out->add_size_m(g.depth_m);
  out->set_poisson_ratio(g.poisson_ratio);
  out->set_has_poisson_ratio(true);
  out->set_thickness_m(g.thickness_m);
  out->set_linear(g.linear);
  v1::Supports* supports = out->mutable_supports();
  supports->set_surface(fixed(g.supports.top));
  supports->set_bottom(fixed(g.supports.bottom));
  supports->set_x_min(fixed(g.supports.left));
  supports->set_x_max(fixed(g.supports.right));
}

v1::SceneKind kind_of(const SceneSnapshot& snapshot) {
  if (!snapshot.modulus || !snapshot.modulus->solid()) return v1::SCENE_KIND_PLANE;
  return extruded(*snapshot.modulus) ? v1::SCENE_KIND_EXTRUDED : v1::SCENE_KIND_SOLID;
}

void evidence_to(const WindowEvidence& in, bool lone, std::uint64_t instance, v1::WindowEvidence* out) {
  for (const std::string& warning : in.warnings) out->add_warnings(warning);
  if (lone) out->add_warnings(lone_warning());
  out->set_youngs_modulus_log_std(in.log_deviation);
  if (in.correlation_m > 0) out->set_youngs_modulus_correlation_m(in.correlation_m);
  out->set_force_relative_std(in.force_relative_deviation);
  out->set_contact_area_relative_std(in.area_relative_deviation);
  out->set_youngs_modulus_common_log_std(in.common_deviation);
  out->set_background_modulus_pa(in.background_modulus_pa);
  out->set_quality(in.quality);
  out->set_measured_share(in.measured_share);
  if (in.taken_in == std::chrono::steady_clock::time_point()) return;
  stamp_to(monotonic_ns(in.taken_in), instance, out->mutable_taken_in());
}

}  // namespace

std::uint64_t scene_bytes(const Scene& scene, v1::SceneView wanted) {
  // Messages with their fields and what allocating each adds; of a cell, its values twice.
  constexpr std::uint64_t kSceneBytes = 512, kWindowBytes = 1024, kWarningBytes = 64;
  const auto snapshot = scene.snapshot();
  std::uint64_t bytes = kSceneBytes + scene.told().words().size();
  if (snapshot->modulus) bytes += 2 * sizeof(double) * snapshot->modulus->slices_m.size();
  for (const auto& window : snapshot->windows) {
    bytes += kWindowBytes;
    if (window->evidence)
      for (const std::string& warning : window->evidence->warnings) bytes += kWarningBytes + warning.size();
  }
  if (wanted != v1::SCENE_VIEW_FULL) return bytes;
  const ImageGrid grid = cells_of(*snapshot, scene.geometry());
  for (const auto& window : snapshot->windows)
    if (window->b_mode) bytes += window->b_mode->grey.size();
  return bytes + 2 * CellView::kCellBytes * grid.size();
}

void scene_to(const Scene& scene, v1::SceneView wanted, std::uint64_t instance, v1::Scene* out) {
  const auto snapshot = scene.snapshot();
  out->set_scene_id(scene.id());
  geometry_to(scene.geometry(), out->mutable_geometry());
  out->set_version(snapshot->version);
  out->set_kind(kind_of(*snapshot));
  if (snapshot->modulus)
    for (const double z_m : snapshot->modulus->slices_m) out->add_slices_z_m(z_m);
  out->set_tissue(scene.told().words());
  for (const auto& window : snapshot->windows) {
    v1::Window* w = out->add_windows();
    w->set_window_id(window->id);
    w->set_version(window->version);
    region_to(window->region, w->mutable_covers());
    w->set_touchable(window->model != nullptr);
    if (window->model) w->set_plan(window->model->plan());
    if (window->evidence)
      evidence_to(*window->evidence, snapshot->lone(*window), instance, w->mutable_evidence());
  }
  if (wanted != v1::SCENE_VIEW_FULL) return;
  const CellView view = view_of(*snapshot, scene.geometry());
  map_to("youngs_modulus", "Pa", view.grid, view.modulus_pa, out->mutable_youngs_modulus());
  map_to("youngs_modulus_log_std", "1", view.grid, view.log_deviation, out->mutable_youngs_modulus_log_std());
  map_to("valid", "1", view.grid, view.valid, out->mutable_valid());
  for (const auto& window : snapshot->windows)
    if (window->b_mode) map_to("b_mode", "1", window->b_mode->grid, window->b_mode->grey, out->add_b_mode());
}

void stamp_to(std::int64_t monotonic_ns, std::uint64_t instance, v1::Stamp* out) {
  out->set_monotonic_ns(monotonic_ns);
  out->set_instance(instance);
}

void region_to(const Region& in, v1::Region* out) {
  out->set_begin_x_m(in.begin_x_m);
  out->set_end_x_m(in.end_x_m);
  if (!in.z) return;
  out->set_begin_z_m(in.z->begin_m);
  out->set_end_z_m(in.z->end_m);
}

void layer_to(const Layer& in, v1::Layer* out) {
  out->set_depth_m(in.depth_m);
  for (const double component : in.normal) out->add_normal(component);
}

std::array<double, 3> vector_from(const char* field, const google::protobuf::RepeatedField<double>& in,
                                  bool may_be_empty) {
  std::array<double, 3> out{};
  if (in.empty() && may_be_empty) return out;
  if (in.size() != 2 && in.size() != 3)
    throw std::invalid_argument(fmt::format("{}: {} values; give [x, y] or [x, y, z]", field, in.size()));
  for (int k = 0; k < in.size(); ++k) {
    if (!std::isfinite(in.Get(k)))
      throw std::invalid_argument(fmt::format("{}[{}]: not finite; send numbers in SI units", field, k));
    out[static_cast<std::size_t>(k)] = in.Get(k);
  }
  return out;
}

std::array<double, 3> origin_along_axes(const std::string& field, const v1::SlicePose& in, const char* what) {
  const auto lies_along = [&](const char* name, const auto& stated, const std::array<double, 3>& axis) {
    const std::string full = field + "." + name;
    if (!stated.empty() && vector_from(full.c_str(), stated, false) != axis)
      throw std::invalid_argument(
          fmt::format("{}: {} lie along the scene's own axes; leave it out", full, what));
  };
  lies_along("lateral", in.lateral(), {1, 0, 0});
  lies_along("axial", in.axial(), {0, 1, 0});
  return vector_from((field + ".origin_m").c_str(), in.origin_m(), false);
}

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
  if (in.pose().origin_m_size() != 3) throw std::invalid_argument(field + ".pose.origin_m: give [0, 0, z]");
  const auto origin_m = origin_along_axes(field + ".pose", in.pose(), "slices");
  for (const std::size_t axis : {0U, 1U})
    if (origin_m[axis] != 0)
      throw std::invalid_argument(
          fmt::format("{}.pose.origin_m[{}]: {}; slices are of the whole plane: give [0, 0, z]", field, axis,
                      origin_m[axis]));
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
  if (in.has_youngs_modulus_log_modes()) {
    const v1::Array& modes = in.youngs_modulus_log_modes();
    const std::size_t changes = modes.shape().empty() ? 0 : modes.shape(0);
    if (changes < 1 || changes > kMaxLogModes)
      throw std::invalid_argument(fmt::format(
          "{}.youngs_modulus_log_modes.shape[0]: {} changes, must be 1 to {}", field, changes, kMaxLogModes));
    const std::vector<double> values = values_from(field + ".youngs_modulus_log_modes", modes,
                                                   {changes, solid.y_m.size() - 1, solid.x_m.size() - 1});
    slice.log_modes.assign(values.begin(), values.end());
  }
  return slice;
}

}  // namespace teletact::service
