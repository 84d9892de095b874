#include "service/scene/state_store.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cerrno>
#include <ctime>
#include <new>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include "service/scene/errors.h"

namespace teletact::service {

VersionCounter::VersionCounter(StateStore* store, std::function<void()> used_up)
    : store_(store),
      used_up_(std::move(used_up)),
      next_(store ? store->first_version() : 1),
      reserved_(store ? store->reserved_versions() : UINT64_MAX) {}

std::uint64_t VersionCounter::next() {
  {
    const std::lock_guard lock(mutex_);
    if (next_ < reserved_) return next_++;
  }
  if (used_up_) used_up_();
  throw Error(
      ErrorKind::kExhausted,
      "state: the versions reserved on disk are used up; free disk space in the folder of --state, and "
      "send it again");
}

void VersionCounter::used(std::uint64_t version) {
  {
    const std::lock_guard lock(mutex_);
    next_ = std::max(next_, version + 1);
    if (version < reserved_) return;
  }
  reserve(version + 1 + StateStore::kVersionBlock);
}

void VersionCounter::reserve_ahead() {
  std::uint64_t limit = 0;
  {
    const std::lock_guard lock(mutex_);
    if (!store_ || reserved_ - next_ > StateStore::kVersionBlock / 2) return;
    limit = reserved_ + StateStore::kVersionBlock;
  }
  reserve(limit);
}

void VersionCounter::reserve(std::uint64_t limit) {
  const std::lock_guard writing(writing_);
  {
    const std::lock_guard lock(mutex_);
    if (limit <= reserved_) return;
  }
  store_->reserve_versions(limit);
  const std::lock_guard lock(mutex_);
  reserved_ = std::max(reserved_, limit);
}

namespace fs = std::filesystem;
using nlohmann::json;

namespace {

constexpr std::size_t kLongest = 500;  // of what the log says of a file's text
const std::string kGone = "deleted-";  // scenes on their way out
constexpr const char* kAside = "set-aside";
constexpr std::uint64_t kMaxVersionBytes = 1000;

std::uint64_t version_in(const std::string& text) {
  const json first = json::parse(text).at("first_unused");
  if (!first.is_number_unsigned() || first == 0 || first > kLargestVersion)
    throw std::runtime_error("first_unused is not a version: " + first.dump());
  return first;
}

}  // namespace

StateStore::StateStore(const fs::path& directory, const Limits& limits, std::shared_ptr<Files> files,
                       bool wait)
    : files_(std::move(files)),
      directory_(fs::absolute(directory).lexically_normal()),
      scenes_(directory_ / "scenes"),
      limits_(limits) {
  try {
    make_folders();
    lock_ = files_->lock(directory_ / "lock");
    if (!lock_ && wait) {
      spdlog::info("event=standing_by state=\"{}\"", directory_.string());
      lock_ = files_->lock(directory_ / "lock", wait);
    }
    if (!lock_)
      throw std::runtime_error(
          fmt::format("--state: {} is in use by another teletact-service; give each its own folder",
                      directory_.string()));
    keep_private();
    sweep();
    const fs::path versions = directory_ / "versions.json";
    try {
      if (files_->exists(versions) || !files_->list(scenes_).empty())
        first_version_ = version_in(files_->read(versions, kMaxVersionBytes));
    } catch (const std::exception& e) {
      // Go on far beyond what any scene can have used.
      first_version_ = static_cast<std::uint64_t>(std::time(nullptr)) * kVersionBlock;
      spdlog::error("event=state_versions_unreadable error=\"{}\" continuing_at={}",
                    shown(e.what(), kLongest), first_version_);
    }
    reserved_ = first_version_;
    try {
      reserve_versions(first_version_ + kVersionBlock);
      reserved_ = first_version_ + kVersionBlock;
    } catch (const FileError& error) {
      if (!wait) throw;
      // Whoever served before has gone: what is there can be touched, and publications are refused with the
      // remedy until there is room.
      spdlog::error("event=state_not_kept error=\"{}\"", error.what());
    }
  } catch (const FileError& error) {
    throw std::runtime_error(fmt::format(
        "--state: {}; give a folder that can be written and locked, with room on its disk", error.what()));
  }
}

// Each folder that is missing, and its name in the one above.
void StateStore::make_folders() {
  std::vector<fs::path> missing;
  for (fs::path folder = scenes_; !files_->exists(folder); folder = folder.parent_path())
    missing.push_back(folder);
  for (auto folder = missing.rbegin(); folder != missing.rend(); ++folder) {
    files_->make_folder(*folder);
    files_->sync(folder->parent_path());
  }
  files_->sync(directory_);  // a process that was killed may have made it and not synced
}

// The folder itself may be somebody else's, /tmp for one; a folder that was made here is not.
void StateStore::keep_private() {
  try {
    for (const char* name : {"lock", "versions.json", "scenes", kAside})
      files_->keep_private(directory_ / name);
  } catch (const FileError& error) {
    spdlog::warn("event=state_not_private error=\"{}\"", error.what());
  }
}

// What a deletion that was cut short has left.
void StateStore::sweep() {
  for (const std::string& name : files_->list(directory_))
    if (name.starts_with(kGone)) files_->remove(directory_ / name);
}

// Its name is not synced yet.
void StateStore::place_file(const fs::path& path, const std::string& bytes) {
  const fs::path temporary = path.string() + ".tmp";
  try {
    files_->write(temporary, std::span(bytes.data(), bytes.size()));
    files_->sync(temporary);
    files_->rename(temporary, path);
  } catch (const FileError&) {
    try {
      files_->remove(temporary);  // a full disk needs the room
    } catch (const FileError&) {
    }
    throw;
  }
}

void StateStore::reserve_versions(std::uint64_t limit) {
  place_file(directory_ / "versions.json", json{{"first_unused", limit}}.dump());
  files_->sync(directory_);
}

void StateStore::save(const SceneRecord& record) {
  const fs::path folder = scenes_ / record.id;
  const EncodedScene scene = encoded(record);
  const fs::path map = folder / scene.map_name;
  const bool made = !files_->exists(folder), map_made = !files_->exists(map);
  bool named = false;  // the map, by scene.json
  try {
    files_->make_folder(folder);
    place_file(map, scene.map);
    files_->sync(folder);
    place_file(folder / "scene.json", scene.description);
    named = true;
    files_->sync(folder);
    files_->sync(scenes_);  // its own name
  } catch (const FileError&) {
    // Nothing half-made is left of a scene that is refused, nor a map that nothing names: a full disk needs
    // the room. If even that fails, the scene is set aside at the next start, and the map goes with the next
    // save.
    if (made || (map_made && !named)) try {
        files_->remove(made ? folder : map);
      } catch (const FileError&) {
      }
    throw;
  }
  try {
    for (const std::string& name : files_->list(folder))  // what scene.json no longer names
      if (name != scene.map_name && name != "scene.json") files_->remove(folder / name);
  } catch (const FileError& error) {  // with the next save
    spdlog::warn("event=state_not_swept error=\"{}\"", error.what());
  }
}

void StateStore::load(const std::string& id, const Take& take, const MemoryAccount& account) {
  // Bytes held for one that is read: the text is parsed, the map is copied.
  constexpr std::uint64_t kOfText = 10, kOfMap = 3;
  std::vector<Charge> charges;
  const auto read = [&](const std::string& name, std::uint64_t held) {
    const fs::path file = scenes_ / id / name;
    const std::uint64_t bytes = files_->size(file);
    charges.push_back(account.charge(Place::kHost, "restoring", held * bytes));
    return files_->read(file, bytes);
  };
  const SceneRecord record = decoded(
      read("scene.json", kOfText), [&](const std::string& name) { return read(name, kOfMap); }, limits_);
  if (record.id != id) throw std::runtime_error("scene_id is not the folder's name");
  take(record);
}

void StateStore::load(const Take& take, const Left& left, const MemoryAccount& account) {
  for (const std::string& id : files_->list(scenes_)) try {
      load(id, take, account);
    } catch (const FileError& e) {
      if (e.number == ENOENT || !left)  // half-made
        set_aside(id, e.what());
      else
        left(id, e.what());
    } catch (const std::bad_alloc& e) {
      if (left) left(id, e.what());
    } catch (const MemoryRefused& e) {
      if (left) left(id, e.what());
    } catch (const std::exception& e) {
      set_aside(id, e.what());
    }
}

void StateStore::set_aside(const std::string& id, const std::string& why) {
  const fs::path aside = directory_ / kAside;
  fs::path to = aside / fmt::format("{}-{}", id, static_cast<std::int64_t>(std::time(nullptr)));
  std::string failed;
  try {
    files_->make_folder(aside);
    files_->sync(directory_);
    while (files_->exists(to)) to += "-again";
    files_->rename(scenes_ / id, to);
    files_->sync(aside);  // first where it goes to
    files_->sync(scenes_);
  } catch (const FileError& error) {
    failed = error.what();
  }
  spdlog::error("event=state_set_aside scene={} error=\"{}\" moved_to=\"{}\" failed=\"{}\"", shown(id),
                shown(why, kLongest), shown(to.string(), kLongest), shown(failed, kLongest));
}

void StateStore::remove(const std::string& id) {
  // Out of the way in one step, then away.
  const fs::path gone = directory_ / (kGone + id);
  files_->remove(gone);
  if (!files_->exists(scenes_ / id)) return;
  files_->rename(scenes_ / id, gone);
  try {
    files_->sync(directory_);
    files_->sync(scenes_);
  } catch (const FileError&) {
    try {
      files_->rename(gone, scenes_ / id);  // it stays
    } catch (const FileError&) {
    }
    throw;
  }
  try {
    files_->remove(gone);
  } catch (const FileError& error) {  // swept at the next start
    spdlog::warn("event=state_not_swept error=\"{}\"", error.what());
  }
}

}  // namespace teletact::service
