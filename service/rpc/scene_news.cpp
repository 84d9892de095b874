#include "service/rpc/scene_news.h"

#include <utility>

#include "service/rpc/palpation_messages.h"

namespace teletact::service {

namespace {

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
