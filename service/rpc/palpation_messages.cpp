#include "service/rpc/palpation_messages.h"

#include <fmt/format.h>

#include <cmath>
#include <stdexcept>

#include "service/rpc/cell_view.h"
#include "service/rpc/core.h"
#include "service/rpc/map_message.h"
#include "service/scene/errors.h"

namespace teletact::service {

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
  if (lone) out->add_warnings(kLoneWarning);
  out->set_youngs_modulus_log_std(in.log_deviation);
  if (in.correlation_m > 0) out->set_youngs_modulus_correlation_m(in.correlation_m);
  out->set_force_relative_std(in.force_relative_deviation);
  out->set_contact_area_relative_std(in.area_relative_deviation);
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
  std::uint64_t bytes = kSceneBytes;
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

}  // namespace teletact::service
