#include "service/rpc/scene_news.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "service/rpc/palpation_messages.h"
#include "service/scene/scene.h"
#include "teletact/v1/palpation.pb.h"

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

// What one who looks on has of a scene's maps, and what is new of them: in parts, so that a message holds no
// more than about kMaxBytes of them, and nothing is sent twice. Not thread-safe.
class ObservedMaps {
 public:
  static constexpr std::size_t kMaxBytes = std::size_t{1} << 20;

  // Throws std::invalid_argument for a name that no map has, or that stands twice.
  explicit ObservedMaps(const google::protobuf::RepeatedPtrField<std::string>& names) {
    const std::array<std::pair<std::string_view, bool*>, 4> known{
        {{"youngs_modulus", &youngs_modulus_},
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
        throw std::invalid_argument(fmt::format("open.maps: {} is given twice; name each map once", name));
    }
  }
  // Of a message at most: a block of columns and an image may go beyond kMaxBytes.
  static std::size_t max_bytes(const SceneSnapshot& snapshot, const SceneGeometry& geometry) {
    std::size_t image = 0;
    for (const auto& window : snapshot.windows)
      if (window->b_mode) image = std::max(image, window->b_mode->grey.size());
    return kMaxBytes + CellBlocks::kColumns * cells_of(snapshot, geometry).ny * CellView::kCellBytes + image;
  }
  // The parts of this snapshot that are new, as many as a message holds. True: there are more.
  bool next(const SceneSnapshot& snapshot, const SceneGeometry& geometry, Parts* out) {
    std::size_t room = kMaxBytes;
    const bool more_cells = cells(snapshot, geometry, room, out);
    return images(snapshot, room, out) || more_cells;
  }

 private:
  bool images(const SceneSnapshot& snapshot, std::size_t& room, Parts* out) {
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
  bool cells(const SceneSnapshot& snapshot, const SceneGeometry& geometry, std::size_t& room, Parts* out) {
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
      if (youngs_modulus_)
        map_to("youngs_modulus", "Pa", view.grid, view.modulus_pa, add_part(snapshot, out));
      if (log_deviation_)
        map_to("youngs_modulus_log_std", "1", view.grid, view.log_deviation, add_part(snapshot, out));
      if (valid_) map_to("valid", "1", view.grid, view.valid, add_part(snapshot, out));
      begin = end;
    }
    return false;
  }
  bool youngs_modulus_ = false, log_deviation_ = false, valid_ = false, b_mode_ = false;
  std::vector<std::uint64_t> sent_;                 // stamp of each block of columns (CellBlocks)
  std::shared_ptr<const ExplicitModulus> modulus_;  // that they are of; null: stitched
  std::map<std::uint64_t, std::shared_ptr<const BMode>> images_;  // the same of each window, by its id
};

constexpr const char* kObservers = "observers";  // all of them have one turn beside who asks for scenes

}  // namespace

struct SceneNews::Work {
  Work(const Core& core, std::shared_ptr<Scene> of, std::string name, const v1::ObserveOpen& open)
      : scene(std::move(of)),
        client(std::move(name)),
        account(core.account(client, scene->id())),
        instance(core.instance),
        windows(open.windows()),
        maps(open.maps()) {}

  const std::shared_ptr<Scene> scene;
  const std::string client;
  const MemoryAccount account;
  const std::uint64_t instance;
  const bool windows;
  ObservedMaps maps;          // of who makes the next
  std::uint64_t version = 0;  // the same: the windows' that were made last
  bool first = true;

  std::mutex mutex;  // of these
  v1::Observation made;
  Charge charge;
  std::exception_ptr failure;
  bool ready = false, more = false;

  void make();
};

void SceneNews::Work::make() {
  scene->require_exists();
  const auto snapshot = scene->snapshot();
  Charge held = account.charge(
      Place::kHost, "answers",
      scene_bytes(*scene, v1::SCENE_VIEW_BASIC) + 2 * ObservedMaps::max_bytes(*snapshot, scene->geometry()));
  v1::Observation next;
  if (windows && (std::exchange(first, false) || version != snapshot->version))
    scene_to(*scene, v1::SCENE_VIEW_BASIC, instance, next.mutable_scene());
  version = snapshot->version;
  const bool rest = maps.next(*snapshot, scene->geometry(), next.mutable_maps());
  held.shrink(2 * next.ByteSizeLong());
  const std::lock_guard lock(mutex);
  ready = next.has_scene() || !next.maps().empty();
  more = rest;
  made = std::move(next);
  charge = std::move(held);
}

SceneNews::SceneNews(const Core& core, Workers& worker, std::shared_ptr<Scene> scene, std::string client,
                     const v1::ObserveOpen& open)
    : worker_(worker), work_(std::make_shared<Work>(core, std::move(scene), std::move(client), open)) {}

SceneNews::~SceneNews() {
  if (posted_ != 0) worker_.cancel(posted_);
}

bool SceneNews::ready() const {
  const std::lock_guard lock(work_->mutex);
  return work_->ready;
}

void SceneNews::look() {
  if (work_.use_count() > 1) return;  // it is being made
  bool more = false;
  {
    const std::lock_guard lock(work_->mutex);
    if (work_->failure) std::rethrow_exception(work_->failure);
    if (work_->ready) return;
    more = work_->more;
  }
  const std::uint64_t version = work_->scene->snapshot()->version;
  if (!more && !first_ && version == version_) return;
  version_ = version, first_ = false;
  posted_ = worker_.post(
      [work = work_] {
        try {
          work->make();
        } catch (const std::exception&) {
          const std::lock_guard lock(work->mutex);
          work->failure = std::current_exception();
        }
      },
      kObservers);
}

void SceneNews::take(v1::Observation& out) {
  const std::lock_guard lock(work_->mutex);
  if (!work_->ready) return;
  if (work_->made.has_scene()) out.mutable_scene()->Swap(work_->made.mutable_scene());
  out.mutable_maps()->Swap(work_->made.mutable_maps());
  sent_ = std::exchange(work_->charge, {});
  work_->ready = false;
}

}  // namespace teletact::service
