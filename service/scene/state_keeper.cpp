#include "service/scene/state_keeper.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <future>
#include <stdexcept>
#include <utility>

#include "service/scene/errors.h"

namespace teletact::service {

StateKeeper::StateKeeper(const std::filesystem::path& directory, const Limits& limits,
                         std::shared_ptr<Files> files, bool standby)
    : directory_(directory), limits_(limits), files_(std::move(files)) {
  if (standby && directory_.empty())
    throw std::runtime_error(
        "--standby: it is for the folder of --state that a service stands by; give that, too");
  if (!standby) open(false);
}

void StateKeeper::open(bool wait) {
  if (!directory_.empty()) store_ = std::make_unique<StateStore>(directory_, limits_, files_, wait);
  versions_ = std::make_shared<VersionCounter>(store_.get(), [this] { reserve_later(); });
}

StateKeeper::~StateKeeper() {
  finish();
}

void StateKeeper::finish() {
  std::set<std::shared_ptr<Scene>> again;
  {
    const std::lock_guard lock(mutex_);
    again = std::exchange(unkept_, {});
  }
  for (const auto& scene : again) keep_later(scene);  // once more
  keeper_.finish();
}

void StateKeeper::let_go() {
  finish();
  const std::lock_guard lock(disk_);
  gone_ = true;
  if (store_) store_->let_go();
}

void StateKeeper::wait_until_idle() {
  std::promise<void> done;  // jobs are done in order
  keeper_.post([&done] { done.set_value(); });
  done.get_future().wait();
}

void StateKeeper::load(const StateStore::Take& take, const StateStore::Left& left,
                       const MemoryAccount& account) {
  if (!versions_) open(true);
  if (store_) store_->load(take, left, account);
}

void StateKeeper::write(const std::shared_ptr<Scene>& scene) {
  const std::lock_guard lock(disk_);
  if (scene->deleted()) return;
  versions_->reserve_ahead();
  store_->save(scene->record());
}

// There may be room by now.
void StateKeeper::reserve_later() {
  keeper_.post([this] {
    const std::lock_guard lock(disk_);
    if (!gone_) try {
        versions_->reserve_ahead();
      } catch (const FileError& error) {
        spdlog::error("event=versions_not_reserved error=\"{}\"", error.what());
      }
  });
}

void StateKeeper::write_or_say(const std::shared_ptr<Scene>& scene) {
  try {
    write(scene);
    note(scene, "");
  } catch (const std::exception& error) {
    note(scene, error.what());
  }
}

void StateKeeper::note(const std::shared_ptr<Scene>& scene, const std::string& why) {
  std::set<std::shared_ptr<Scene>> again;
  bool changed = false;
  {
    const std::lock_guard lock(mutex_);
    changed = trouble_.empty() != why.empty();
    trouble_ = why;
    if (why.empty()) {
      unkept_.erase(scene);
      again = std::exchange(unkept_, {});
    } else {
      unkept_.insert(scene);
    }
  }
  if (changed && !why.empty())
    spdlog::error("event=state_not_kept scene={} error=\"{}\" until=\"it can be written: free space\"",
                  scene->id(), why);
  if (changed && why.empty()) spdlog::info("event=state_kept_again scene={}", scene->id());
  for (const auto& other : again) keep_later(other);
}

void StateKeeper::keep_later(const std::shared_ptr<Scene>& scene) {
  if (!store_) return;
  {
    const std::lock_guard lock(mutex_);
    if (!waiting_.insert(scene).second) return;  // the job that waits will write the newest
  }
  keeper_.post([this, scene] {
    {
      const std::lock_guard lock(mutex_);
      waiting_.erase(scene);
    }
    write_or_say(scene);
  });
}

void StateKeeper::keep_new(const std::shared_ptr<Scene>& scene,
                           std::function<void(std::exception_ptr)> done) {
  if (!store_) return done(nullptr);
  keeper_.post([this, scene, done = std::move(done)] {
    try {
      write(scene);
    } catch (const FileError& error) {
      spdlog::error("event=scene_not_kept scene={} error=\"{}\"", scene->id(), error.what());
      return done(std::make_exception_ptr(
          error.full()
              ? Error(ErrorKind::kExhausted,
                      "state: the disk is full, and a scene that cannot be kept would be lost at a restart; "
                      "free space in the folder of --state")
              : Error(ErrorKind::kUnavailable,
                      "state: the disk fails, and a scene that cannot be kept would be lost at a restart; "
                      "the service's log says where")));
    } catch (...) {
      return done(std::current_exception());
    }
    done(nullptr);
  });
}

void StateKeeper::remove(const std::function<std::shared_ptr<Scene>()>& find,
                         const std::function<void(const std::shared_ptr<Scene>&)>& gone) {
  const std::lock_guard lock(disk_);
  const auto scene = find();
  if (gone_)
    throw Error(ErrorKind::kUnavailable,
                "state: this service stops and has given its folder up; connect again");
  try {
    if (store_) store_->remove(scene->id());
  } catch (const FileError& error) {
    spdlog::error("event=scene_not_removed scene={} error=\"{}\"", scene->id(), error.what());
    keep_later(scene);  // half of it may be gone
    throw Error(ErrorKind::kUnavailable,
                fmt::format("state: scene {} cannot be taken from disk and stays; the service's log says why",
                            scene->id()));
  }
  gone(scene);
}

std::string StateKeeper::trouble() const {
  const std::lock_guard lock(mutex_);
  return trouble_;
}

}  // namespace teletact::service
