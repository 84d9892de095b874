#include "service/rpc/observed_maps.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <stdexcept>
#include <utility>

#include "service/rpc/map_message.h"

namespace teletact::service {

namespace {

using Parts = google::protobuf::RepeatedPtrField<v1::ObservedMap>;

v1::Map* add_part(const SceneSnapshot& snapshot, Parts* out) {
  v1::ObservedMap* part = out->Add();
  part->set_version(snapshot.version);
  return part->mutable_map();
}

// Another number for each block whenever its cells are others; 0: there are none.
std::uint64_t stamp_of(const SceneSnapshot& snapshot, std::size_t block) {
  return snapshot.modulus ? 1 : snapshot.map->cells().stamp(block);
}

}  // namespace

ObservedMaps::ObservedMaps(const google::protobuf::RepeatedPtrField<std::string>& names) {
  const std::array<std::pair<std::string_view, bool*>, 4> known{{{"youngs_modulus", &youngs_modulus_},
                                                                 {"youngs_modulus_log_std", &log_deviation_},
                                                                 {"valid", &valid_},
                                                                 {"b_mode", &b_mode_}}};
  for (const std::string& name : names) {
    const auto* const map =
        std::find_if(known.begin(), known.end(), [&](const auto& k) { return k.first == name; });
    if (map == known.end())
      throw std::invalid_argument(
          "open.maps: unknown; use youngs_modulus, youngs_modulus_log_std, valid or b_mode");
    if (std::exchange(*map->second, true))
      throw std::invalid_argument(fmt::format("open.maps: {} stands twice; name each map once", name));
  }
}

bool ObservedMaps::cells(const SceneSnapshot& snapshot, const SceneGeometry& geometry, std::size_t& room,
                         Parts* out) {
  if (!youngs_modulus_ && !log_deviation_ && !valid_) return false;
  const ImageGrid grid = cells_of(snapshot, geometry);
  constexpr std::size_t kColumns = CellBlocks::kColumns;
  const std::size_t blocks = (grid.nx + kColumns - 1) / kColumns;
  if (std::exchange(modulus_, snapshot.modulus) != snapshot.modulus) sent_.clear();
  sent_.resize(blocks, 0);
  const std::size_t block_bytes = kColumns * grid.ny * CellView::kCellBytes;
  for (std::size_t begin = 0; begin < blocks;) {
    std::size_t end = begin;
    for (; end < blocks && sent_[end] != stamp_of(snapshot, end) && room > 0; ++end) {
      sent_[end] = stamp_of(snapshot, end);
      room -= std::min(room, block_bytes);
    }
    if (end == begin) {
      if (sent_[begin] != stamp_of(snapshot, begin)) return true;  // there is no room left
      ++begin;
      continue;
    }
    const CellView view = view_of(snapshot, geometry, begin * kColumns, end * kColumns);
    if (youngs_modulus_) map_to("youngs_modulus", "Pa", view.grid, view.modulus_pa, add_part(snapshot, out));
    if (log_deviation_)
      map_to("youngs_modulus_log_std", "1", view.grid, view.log_deviation, add_part(snapshot, out));
    if (valid_) map_to("valid", "1", view.grid, view.valid, add_part(snapshot, out));
    begin = end;
  }
  return false;
}

bool ObservedMaps::images(const SceneSnapshot& snapshot, std::size_t& room, Parts* out) {
  if (!b_mode_) return false;
  auto windows = snapshot.windows;  // where they overlap the newest is drawn last
  std::ranges::sort(windows, {}, [](const auto& window) { return window->version; });
  std::map<std::uint64_t, std::shared_ptr<const BMode>> now;
  bool more = false;
  for (const auto& window : windows) {
    if (!window->b_mode) continue;
    const auto known = images_.find(window->id);
    if (known != images_.end() && known->second == window->b_mode) {
      now.insert(*known);
    } else if (room == 0 || more) {
      more = true;
    } else {
      v1::Map* map = add_part(snapshot, out);
      map_to("b_mode", "1", window->b_mode->grid, window->b_mode->grey, map);
      out->rbegin()->set_window_id(window->id);
      room -= std::min(room, window->b_mode->grey.size());
      now.emplace(window->id, window->b_mode);
    }
  }
  images_ = std::move(now);
  return more;
}

std::size_t ObservedMaps::max_bytes(const SceneSnapshot& snapshot, const SceneGeometry& geometry) {
  std::size_t image = 0;
  for (const auto& window : snapshot.windows)
    if (window->b_mode) image = std::max(image, window->b_mode->grey.size());
  return kMaxBytes + CellBlocks::kColumns * cells_of(snapshot, geometry).ny * CellView::kCellBytes + image;
}

bool ObservedMaps::next(const SceneSnapshot& snapshot, const SceneGeometry& geometry, Parts* out) {
  std::size_t room = kMaxBytes;
  const bool more_cells = cells(snapshot, geometry, room, out);
  return images(snapshot, room, out) || more_cells;
}

}  // namespace teletact::service
