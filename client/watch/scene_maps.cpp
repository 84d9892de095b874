#include "client/watch/scene_maps.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <set>
#include <string>

namespace teletact::client {
namespace {

// [first column of the scene .. its columns): where a part's columns lie among the scene's.
std::optional<std::size_t> column_of(double origin_m, double spacing_m) {
  const double column = origin_m / spacing_m - 0.5;
  if (!(std::abs(column - std::round(column)) < 1e-3) || column < -0.5) return std::nullopt;
  return static_cast<std::size_t>(std::lround(column));
}

template <class Value>
void copy_columns(const std::string& from, std::size_t columns, std::vector<Value>& to, std::size_t begin,
                  std::size_t nx, std::size_t ny) {
  for (std::size_t j = 0; j < ny; ++j)
    std::memcpy(to.data() + begin + nx * j, from.data() + columns * j * sizeof(Value),
                columns * sizeof(Value));
}

nlohmann::json two(const double (&values)[2]) {
  return {values[0], values[1]};
}

}  // namespace

std::optional<SceneMaps::Grid> SceneMaps::grid_of(const v1::Map& map) {
  const v1::Grid& in = map.grid();
  if (in.size_size() != 2 || in.origin_m_size() < 2 || in.spacing_m_size() < 2) return std::nullopt;
  const Grid grid{
      in.size(0), in.size(1), {in.origin_m(0), in.origin_m(1)}, {in.spacing_m(0), in.spacing_m(1)}};
  for (const double place_m : grid.origin_m)
    if (!std::isfinite(place_m)) return std::nullopt;
  for (const double spacing_m : grid.spacing_m)
    if (!(spacing_m > 0) || !std::isfinite(spacing_m)) return std::nullopt;
  if (grid.nx == 0 || grid.ny == 0 || grid.nx > kMaxCells || grid.ny > kMaxCells / grid.nx)
    return std::nullopt;
  return grid;
}

void SceneMaps::clear() {
  const std::uint64_t drawn = drawn_;
  *this = SceneMaps();
  drawn_ = drawn;
  cells_changed_ = images_changed_ = true;
}

void SceneMaps::take(const v1::Scene& scene) {
  if (scene.has_youngs_modulus()) return take_whole(scene);
  const double width_m = scene.geometry().size_m_size() > 0 ? scene.geometry().size_m(0) : 0;
  if (width_m != width_m_ && grid_) {
    grid_.reset();
    cells_changed_ = true;
  }
  width_m_ = width_m;
  std::set<std::uint64_t> windows;
  for (const v1::Window& window : scene.windows()) windows.insert(window.window_id());
  if (std::erase_if(images_, [&](const auto& image) { return !windows.contains(image.first); }) > 0)
    images_changed_ = true;
}

void SceneMaps::take_whole(const v1::Scene& scene) {
  grid_.reset();
  images_.clear();
  cells_changed_ = images_changed_ = true;
  const auto grid = grid_of(scene.youngs_modulus());
  if (!grid) return;
  width_m_ = grid->spacing_m[0] * static_cast<double>(grid->nx);
  const auto add = [&](const v1::Map& map, const char* name, std::uint64_t window) {
    v1::ObservedMap part;
    *part.mutable_map() = map;
    part.mutable_map()->set_name(name);
    part.set_version(scene.version());
    part.set_window_id(window);
    return take(part);
  };
  if (!add(scene.youngs_modulus(), "youngs_modulus", 0)) return;
  if (!add(scene.valid(), "valid", 0)) std::ranges::fill(valid_, std::uint8_t{1});
  add(scene.youngs_modulus_log_std(), "youngs_modulus_log_std", 0);
  std::uint64_t window = 0;  // which it is of is not said
  for (const v1::Map& image : scene.b_mode()) add(image, "b_mode", ++window);
}

bool SceneMaps::take(const v1::ObservedMap& part) {
  const auto grid = grid_of(part.map());
  if (!grid) return false;
  const bool taken = part.map().name() == "b_mode" ? take_image(*grid, part) : take_cells(*grid, part.map());
  if (taken) version_ = std::max(version_, part.version());
  return taken;
}

bool SceneMaps::take_cells(const Grid& part, const v1::Map& map) {
  const auto begin = column_of(part.origin_m[0], part.spacing_m[0]);
  const double columns = std::round(width_m_ / part.spacing_m[0]);
  if (!begin || !(columns >= 1 && columns * static_cast<double>(part.ny) <= double{kMaxCells})) return false;
  const auto nx = static_cast<std::size_t>(columns);
  if (*begin + part.nx > nx) return false;
  const bool flags = map.name() == "valid";
  if (map.values().dtype() != (flags ? v1::DATA_TYPE_UINT8 : v1::DATA_TYPE_FLOAT32) ||
      map.values().data().size() != part.nx * part.ny * (flags ? 1 : sizeof(float)))
    return false;
  if (!flags && map.name() != "youngs_modulus" && map.name() != "youngs_modulus_log_std") return false;
  if (!grid_ || grid_->nx != nx || grid_->ny != part.ny || grid_->spacing_m[0] != part.spacing_m[0] ||
      grid_->spacing_m[1] != part.spacing_m[1]) {
    grid_ =
        Grid{nx, part.ny, {part.spacing_m[0] / 2, part.origin_m[1]}, {part.spacing_m[0], part.spacing_m[1]}};
    modulus_pa_.assign(nx * part.ny, 0.0F);
    log_deviation_.assign(nx * part.ny, std::numeric_limits<float>::quiet_NaN());
    valid_.assign(nx * part.ny, 0);
  }
  const std::string& data = map.values().data();
  if (flags)
    copy_columns(data, part.nx, valid_, *begin, nx, part.ny);
  else
    copy_columns(data, part.nx, map.name() == "youngs_modulus" ? modulus_pa_ : log_deviation_, *begin, nx,
                 part.ny);
  return cells_changed_ = true;
}

bool SceneMaps::take_image(const Grid& part, const v1::ObservedMap& image) {
  const std::string& grey = image.map().values().data();
  if (image.map().values().dtype() != v1::DATA_TYPE_UINT8 || grey.size() != part.nx * part.ny) return false;
  if (grey.size() > kMaxNodes) return false;
  images_[image.window_id()] = {part, image.version(), ++drawn_, {grey.begin(), grey.end()}};
  make_room();
  return images_changed_ = true;
}

void SceneMaps::make_room() {
  std::size_t bytes = 0;
  for (const auto& [window, image] : images_) bytes += image.grey.size();
  while (images_.size() > kMaxImages || bytes > kMaxImageBytes) {
    const auto oldest =
        std::ranges::min_element(images_, {}, [](const auto& one) { return one.second.drawn; });
    bytes -= oldest->second.grey.size();
    images_.erase(oldest);
  }
}

Slot SceneMaps::cells() const {
  if (!grid_) return Slot();
  Slot slot(
      {{"version", version_}, {"origin_m", two(grid_->origin_m)}, {"spacing_m", two(grid_->spacing_m)}});
  slot.add("modulus_pa", {grid_->ny, grid_->nx}, modulus_pa_);
  slot.add("log_std", {grid_->ny, grid_->nx}, log_deviation_);
  slot.add("valid", {grid_->ny, grid_->nx}, valid_);
  return slot;
}

Slot SceneMaps::images() const {
  std::vector<std::pair<std::uint64_t, const Image*>> in_order;
  for (const auto& [window, image] : images_) in_order.emplace_back(window, &image);
  std::ranges::sort(in_order, {}, [](const auto& one) { return one.second->drawn; });
  Slot slot;
  for (const auto& [window, image] : in_order) {
    slot.add("b_mode", {image->grid.ny, image->grid.nx}, image->grey);
    slot.of_array({{"window", window},
                   {"version", image->version},
                   {"drawn", image->drawn},
                   {"origin_m", two(image->grid.origin_m)},
                   {"spacing_m", two(image->grid.spacing_m)}});
  }
  return slot;
}

}  // namespace teletact::client
