#include "client/acquire/slice_scene.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <thread>
#include <utility>

#include "client/acquire/map_output.h"
#include "client/clock/clock.h"
#include "client/link/retry.h"
#include "client/link/scenes.h"

namespace teletact::client {
namespace {

constexpr double kColumnM = 0.002, kRowM = 0.001;
constexpr auto kSceneDeadline = std::chrono::seconds(60);

std::size_t parts(double whole_m, double part_m) {
  return static_cast<std::size_t>(std::max(2.0, std::round(whole_m / part_m)));
}

v1::Array array_of(const SliceGrid& grid, const std::vector<float>& values) {
  v1::Array out;
  out.set_dtype(v1::DATA_TYPE_FLOAT32);
  const std::size_t elements = grid.rows() * grid.columns();
  if (values.size() != elements) out.add_shape(static_cast<std::uint32_t>(values.size() / elements));
  for (const std::size_t n : {grid.rows(), grid.columns()}) out.add_shape(static_cast<std::uint32_t>(n));
  out.set_data(values.data(), values.size() * sizeof(float));
  return out;
}

float variance_of_modes(const SlicePlane& plane, std::size_t element) {
  float variance = 0;
  for (std::size_t at = element; at < plane.log_modes.size(); at += plane.log_std.size())
    variance += plane.log_modes[at] * plane.log_modes[at];
  return variance;
}

// Elements that nothing was measured of.
void continue_measured(const SliceGrid& grid, const std::vector<int>& nodes, SlicePlane& plane) {
  const std::size_t columns = grid.columns();
  const SlicePlane measured = plane;
  const auto apart_m = [&](std::size_t a, std::size_t b) {
    const auto between = [](std::size_t p, std::size_t q) {
      return static_cast<double>(p) - static_cast<double>(q);
    };
    return std::hypot(between(a % columns, b % columns) * grid.column_m(),
                      between(a / columns, b / columns) * grid.row_m());
  };
  for (std::size_t n = 0; n < nodes.size(); ++n) {
    if (nodes[n] > 0) continue;
    std::size_t nearest = nodes.size();
    for (std::size_t m = 0; m < nodes.size(); ++m)
      if (nodes[m] > 0 && (nearest == nodes.size() || apart_m(n, m) < apart_m(n, nearest))) nearest = m;
    plane.pa[n] = measured.pa[nearest];
    // What lies above is as the modes say, which reach to the surface; else nobody knows it.
    const bool above = !plane.log_modes.empty() && n / columns < nearest / columns;
    if (!above)
      for (std::size_t first = 0; first < plane.log_modes.size(); first += nodes.size())
        plane.log_modes[first + n] = measured.log_modes[first + nearest];
    const float own = variance_of_modes(measured, n), of_nearest = variance_of_modes(measured, nearest),
                squared = measured.log_std[nearest] * measured.log_std[nearest];
    plane.log_std[n] = above ? std::sqrt(std::max(own, own + squared - of_nearest))
                             : std::hypot(measured.log_std[nearest], std::numbers::ln2_v<float>);
  }
}

// Changes of the logarithm on cells, bilinear between their middles; beyond them those of the nearest.
class Modes {
 public:
  explicit Modes(const v1::Map& map) : cells_(map.grid()), values_(values_of(map)) {}
  std::size_t count() const { return cells_.size(2); }
  // Adds each to the element's; the sum of their squares.
  float add(double x_m, double y_m, SlicePlane& plane, std::size_t element) const {
    const Between i = between(0, x_m), j = between(1, y_m);
    float squares = 0;
    for (std::size_t mode = 0; mode < count(); ++mode) {
      const auto at = [&](std::size_t column, std::size_t row) {
        return values_[column + cells_.size(0) * (row + cells_.size(1) * mode)];
      };
      const float change = std::lerp(std::lerp(at(i.first, j.first), at(i.last, j.first), i.way),
                                     std::lerp(at(i.first, j.last), at(i.last, j.last), i.way), j.way);
      plane.log_modes[element + mode * plane.log_std.size()] += change, squares += change * change;
    }
    return squares;
  }

 private:
  struct Between {
    std::size_t first, last;
    float way;
  };
  Between between(int axis, double at_m) const {
    const double last = cells_.size(axis) - 1.0,
                 at = std::clamp((at_m - cells_.origin_m(axis)) / cells_.spacing_m(axis), 0.0, last),
                 first = std::floor(at);
    return {static_cast<std::size_t>(first), static_cast<std::size_t>(std::min(first + 1, last)),
            static_cast<float>(at - first)};
  }
  v1::Grid cells_;
  std::vector<float> values_;
};

}  // namespace

std::size_t SliceGrid::columns() const {
  return parts(width_m, kColumnM);
}
std::size_t SliceGrid::rows() const {
  return parts(depth_m, kRowM);
}

SlicePlane slice_plane(const std::vector<v1::Map>& maps, const SliceGrid& grid) {
  const v1::Map& modulus = map_of(maps, "youngs_modulus");
  const std::vector<float> pa = values_of(modulus), valid = values_of(map_of(maps, "valid")),
                           log_std = values_of(map_of(maps, "youngs_modulus_log_std"));
  if (valid.size() != pa.size() || log_std.size() != pa.size())
    throw ServiceError(grpc::StatusCode::INTERNAL, "Estimate: the service's maps have different sizes");
  const auto told = std::ranges::find(maps, "youngs_modulus_log_modes", &v1::Map::name);
  const std::optional<Modes> modes =
      told != maps.end() && told->grid().size_size() == 3 ? std::optional<Modes>(*told) : std::nullopt;
  const v1::Grid& nodes = modulus.grid();
  const std::size_t columns = grid.columns(), elements = columns * grid.rows();
  std::vector<int> count(elements, 0);
  std::vector<double> logarithm(elements, 0), deviation(elements, 0);  // that modes leave: its square
  SlicePlane plane{std::vector<float>(elements), std::vector<float>(elements),
                   std::vector<float>(modes ? modes->count() * elements : 0)};
  for (std::size_t n = 0; n < pa.size(); ++n) {
    if (valid[n] == 0 || !(pa[n] > 0) || !std::isfinite(pa[n]) || !std::isfinite(log_std[n])) continue;
    const auto across = static_cast<double>(n % nodes.size(0)), down = static_cast<double>(n / nodes.size(0));
    const double x_m = nodes.origin_m(0) + across * nodes.spacing_m(0),
                 y_m = nodes.origin_m(1) + down * nodes.spacing_m(1), i = x_m / grid.column_m(),
                 j = y_m / grid.row_m();
    if (!(i >= 0 && j >= 0 && i < static_cast<double>(columns) && j < static_cast<double>(grid.rows())))
      continue;
    const std::size_t element = static_cast<std::size_t>(i) + columns * static_cast<std::size_t>(j);
    ++count[element], logarithm[element] += std::log(pa[n]);
    deviation[element] +=
        modes ? std::max(0.0F, log_std[n] * log_std[n] - modes->add(x_m, y_m, plane, element)) : log_std[n];
  }
  if (std::ranges::all_of(count, [](int c) { return c == 0; }))
    throw ServiceError(grpc::StatusCode::FAILED_PRECONDITION, "Estimate: the slice has no valid modulus");
  for (std::size_t n = 0; n < elements; ++n) {
    const auto middle = [](std::size_t at, double step_m) {
      return (static_cast<double>(at) + 0.5) * step_m;
    };
    if (count[n] == 0) {
      if (modes)
        modes->add(middle(n % columns, grid.column_m()), middle(n / columns, grid.row_m()), plane, n);
      continue;
    }
    for (std::size_t at = n; at < plane.log_modes.size(); at += elements)
      plane.log_modes[at] /= static_cast<float>(count[n]);
    plane.pa[n] = static_cast<float>(std::exp(logarithm[n] / count[n]));
    const auto left = static_cast<float>(deviation[n] / count[n]);
    plane.log_std[n] = modes ? std::sqrt(left + variance_of_modes(plane, n)) : left;
  }
  continue_measured(grid, count, plane);
  return plane;
}

SliceScene::SliceScene(const std::shared_ptr<grpc::Channel>& channel, std::string scene_id, SliceGrid grid,
                       double retry_for_s)
    : stub_(v1::Palpation::NewStub(channel)),
      scene_id_(std::move(scene_id)),
      grid_(grid),
      retry_for_s_(retry_for_s) {}

PublishedSlice SliceScene::publish(std::size_t slice, const std::vector<v1::Map>& maps,
                                   const std::atomic<bool>& stop) {
  SlicePlane plane = slice_plane(maps, grid_);
  v1::ModulusSlice message;
  for (const double o : {0.0, 0.0, grid_.places.z_m(slice)}) message.mutable_pose()->add_origin_m(o);
  *message.mutable_modulus()->mutable_youngs_modulus_pa() = array_of(grid_, plane.pa);
  *message.mutable_youngs_modulus_log_std() = array_of(grid_, plane.log_std);
  if (!plane.log_modes.empty())
    *message.mutable_youngs_modulus_log_modes() = array_of(grid_, plane.log_modes);
  const std::int64_t give_up_ns = monotonic_ns() + static_cast<std::int64_t>(retry_for_s_ * 1e9);
  Backoff backoff(0.05, 0.5);
  for (bool again = false;; again = true) {
    PublishedSlice published;
    grpc::Status status = made() ? add(message, published) : create(message, published);
    // An attempt whose answer was lost may have made it.
    if (again && !made() && status.error_code() == grpc::StatusCode::ALREADY_EXISTS && holds_only(message))
      status = add(message, published);
    if (status.ok()) {
      planes_[slice] = std::move(plane);
      return published;
    }
    if (status.error_code() != grpc::StatusCode::UNAVAILABLE || monotonic_ns() > give_up_ns)
      throw_status(made() ? "PublishSlice" : "CreateScene", status);
    if (stop) throw ServiceError(grpc::StatusCode::CANCELLED, "PublishSlice: stopped");
    std::this_thread::sleep_for(std::chrono::duration<double>(backoff.next_s()));
  }
}

grpc::Status SliceScene::create(const v1::ModulusSlice& slice, PublishedSlice& published) {
  v1::CreateSceneRequest request;
  request.set_scene_id(scene_id_);
  for (const double size_m : {grid_.width_m, grid_.depth_m}) request.mutable_geometry()->add_size_m(size_m);
  request.mutable_geometry()->set_poisson_ratio(grid_.poisson_ratio);
  request.mutable_geometry()->set_has_poisson_ratio(true);
  request.mutable_geometry()->set_linear(true);
  const auto nodes = [](std::size_t count, double step_m, double whole_m, auto* out) {
    for (std::size_t n = 0; n < count; ++n) out->Add(step_m * static_cast<double>(n));
    out->Add(whole_m);
  };
  nodes(grid_.columns(), grid_.column_m(), grid_.width_m, request.mutable_modulus()->mutable_x_m());
  nodes(grid_.rows(), grid_.row_m(), grid_.depth_m, request.mutable_modulus()->mutable_y_m());
  const SlicePlaces& places = grid_.places;
  for (std::size_t n = 0; n <= places.count; ++n)
    request.mutable_modulus()->add_z_m(places.z_m(n) - places.pitch_m / 2);
  *request.add_slices() = slice;
  grpc::ClientContext context;
  name_scene(context, scene_id_);
  context.set_deadline(std::chrono::system_clock::now() + kSceneDeadline);
  v1::Scene scene;
  const grpc::Status status = stub_->CreateScene(&context, request, &scene);
  published.version = scene.version();
  return status;
}

// Whether the scene is as this one would be made with that slice, and not somebody else's of the same name.
bool SliceScene::holds_only(const v1::ModulusSlice& slice) {
  v1::Scene scene;
  if (!get_scene(*stub_, scene_id_, v1::SCENE_VIEW_BASIC, scene, kSceneDeadline).ok()) return false;
  constexpr double kSameM = 1e-9;
  const auto& size_m = scene.geometry().size_m();
  return size_m.size() >= 2 && std::abs(size_m[0] - grid_.width_m) < kSameM &&
         std::abs(size_m[1] - grid_.depth_m) < kSameM && scene.slices_z_m_size() == 1 &&
         std::abs(scene.slices_z_m(0) - slice.pose().origin_m(2)) < kSameM;
}

grpc::Status SliceScene::add(const v1::ModulusSlice& slice, PublishedSlice& published) {
  v1::PublishSliceRequest request;
  request.set_scene_id(scene_id_);
  *request.mutable_slice() = slice;
  grpc::ClientContext context;
  name_scene(context, scene_id_);
  context.set_deadline(std::chrono::system_clock::now() + kSceneDeadline);
  v1::PublishSliceResponse response;
  const grpc::Status status = stub_->PublishSlice(&context, request, &response);
  published = {response.version(), {response.warnings().begin(), response.warnings().end()}};
  return status;
}

MetaImage slice_volume(const SliceGrid& grid, const std::map<std::size_t, SlicePlane>& planes,
                       std::vector<float> SlicePlane::*values) {
  const std::size_t plane = grid.columns() * grid.rows();
  std::vector<float> all(plane * grid.places.count, std::numeric_limits<float>::quiet_NaN());
  for (const auto& [slice, values_there] : planes)
    std::ranges::copy(values_there.*values, all.begin() + static_cast<std::ptrdiff_t>(slice * plane));
  return MetaImage::of<float>({grid.columns(), grid.rows(), grid.places.count},
                              {grid.column_m(), grid.row_m(), grid.places.pitch_m},
                              {grid.column_m() / 2, grid.row_m() / 2, grid.places.first_z_m}, all);
}

}  // namespace teletact::client
