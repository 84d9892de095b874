#include "service/scene/state_store.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <ctime>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <span>
#include <stdexcept>

namespace teletact::service {

namespace fs = std::filesystem;
using nlohmann::json;

namespace {

// 1 had neither evidence nor deviations; it is still read.
constexpr int kFormat = 2, kFirstFormat = 1;

[[noreturn]] void fail(const fs::path& path, const char* what) {
  throw std::runtime_error(fmt::format("--state: {} {}: {}; give a folder that can be written", what,
                                       path.string(), std::strerror(errno)));
}

void sync_folder(const fs::path& folder) {
  const int file = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (file < 0) fail(folder, "cannot open");
  const int rc = ::fsync(file);
  ::close(file);
  if (rc != 0) fail(folder, "cannot sync");
}

// Beside its place, synced, renamed, the folder synced.
void write_file(const fs::path& path, std::span<const char> bytes) {
  const fs::path temporary = path.string() + ".tmp";
  const int file = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (file < 0) fail(temporary, "cannot write");
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t wrote = ::write(file, bytes.data() + done, bytes.size() - done);
    if (wrote <= 0) {
      ::close(file);
      fail(temporary, "cannot write");
    }
    done += static_cast<std::size_t>(wrote);
  }
  const int synced = ::fsync(file);
  ::close(file);
  if (synced != 0) fail(temporary, "cannot sync");
  if (::rename(temporary.c_str(), path.c_str()) != 0) fail(path, "cannot rename");
  sync_folder(path.parent_path());
}

std::string read_file(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw std::runtime_error(fmt::format("{} is missing or unreadable", path.filename().string()));
  return {std::istreambuf_iterator<char>(in), {}};
}

// FNV-1a, 64 bit: tells a damaged file from a whole one.
std::string checksum(std::string_view bytes) {
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  for (const char c : bytes) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3ULL;
  return fmt::format("{:016x}", hash);
}

template <class T>
void append(std::string& out, const std::vector<T>& values) {
  out.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
}

template <class T>
std::vector<T> take(std::string_view& in, std::size_t count) {
  if (count > in.size() / sizeof(T)) throw std::runtime_error("the map file is too short");
  std::vector<T> values(count);
  std::memcpy(values.data(), in.data(), count * sizeof(T));
  in.remove_prefix(count * sizeof(T));
  return values;
}

// Room for ever, and for adding blocks without overflow.
constexpr std::uint64_t kLargestVersion = std::uint64_t{1} << 62;

std::uint64_t read_version(const fs::path& versions) {
  const json first = json::parse(read_file(versions)).at("first_unused");
  if (!first.is_number_unsigned() || first == 0 || first > kLargestVersion)
    throw std::runtime_error("first_unused is not a version: " + first.dump());
  return first;
}

json to_json(const SceneGeometry& g) {
  const auto fixed = [](EdgeSupport e) { return e == EdgeSupport::kFixed; };
  return {{"width_m", g.width_m},
          {"depth_m", g.depth_m},
          {"poisson_ratio", g.poisson_ratio},
          {"thickness_m", g.thickness_m},
          {"fixed_top", fixed(g.supports.top)},
          {"fixed_bottom", fixed(g.supports.bottom)},
          {"fixed_left", fixed(g.supports.left)},
          {"fixed_right", fixed(g.supports.right)}};
}

SceneGeometry geometry_from(const json& j, const Limits& limits) {
  const auto edge = [&j](const char* key) {
    return j.at(key).get<bool>() ? EdgeSupport::kFixed : EdgeSupport::kFree;
  };
  SceneGeometry g;
  g.width_m = j.at("width_m");
  g.depth_m = j.at("depth_m");
  g.poisson_ratio = j.at("poisson_ratio");
  g.thickness_m = j.at("thickness_m");
  g.supports = {edge("fixed_top"), edge("fixed_bottom"), edge("fixed_left"), edge("fixed_right")};
  validate(g, limits);
  return g;
}

json to_json(const WindowEvidence& e) {
  const auto number = [](double value) { return std::isfinite(value) ? value : 0; };  // json knows no other
  return {{"warnings", e.warnings},
          {"log_deviation", number(e.log_deviation)},
          {"force_relative_deviation", number(e.force_relative_deviation)},
          {"area_relative_deviation", number(e.area_relative_deviation)},
          {"background_modulus_pa", number(e.background_modulus_pa)},
          {"quality", number(e.quality)},
          {"measured_share", number(e.measured_share)}};
}

std::shared_ptr<const WindowEvidence> evidence_from(const json& j) {
  auto e = std::make_shared<WindowEvidence>();
  e->warnings = j.at("warnings").get<std::vector<std::string>>();
  e->log_deviation = j.at("log_deviation");
  e->force_relative_deviation = j.at("force_relative_deviation");
  e->area_relative_deviation = j.at("area_relative_deviation");
  e->background_modulus_pa = j.at("background_modulus_pa");
  e->quality = j.at("quality");
  e->measured_share = j.at("measured_share");
  return e;
}

// What a whole file can still say wrong, after a hand has been at it. NaN fails too.
void check(const SceneRecord& record) {
  if (record.version > kLargestVersion) throw std::runtime_error("version: too large");
  std::set<std::uint64_t> ids;
  for (const WindowRecord& w : record.windows) {
    const bool placed = w.begin_m >= 0 && w.begin_m < w.end_m && w.end_m <= 1.001 * record.geometry.width_m;
    if (!placed || w.id == 0 || w.version > record.version || !ids.insert(w.id).second)
      throw std::runtime_error(
          fmt::format("windows: {} [{}, {}) m of version {} cannot be", w.id, w.begin_m, w.end_m, w.version));
  }
}

}  // namespace

StateStore::StateStore(fs::path directory, const Limits& limits)
    : directory_(std::move(directory)), limits_(limits) {
  std::error_code error;
  fs::create_directories(directory_ / "scenes", error);
  if (error)
    throw std::runtime_error(fmt::format("--state: cannot make {}: {}; give a folder that can be written",
                                         (directory_ / "scenes").string(), error.message()));
  lock_file_ = ::open((directory_ / "lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (lock_file_ < 0) fail(directory_, "cannot write");
  if (::flock(lock_file_, LOCK_EX | LOCK_NB) != 0) {
    ::close(lock_file_);
    throw std::runtime_error(fmt::format(
        "--state: {} is in use by another teletact-service; give each its own folder", directory_.string()));
  }
  const fs::path versions = directory_ / "versions.json";
  try {
    if (fs::exists(versions) || !fs::is_empty(directory_ / "scenes")) first_version_ = read_version(versions);
  } catch (const std::exception& e) {
    // Go on far beyond what any scene can have used.
    first_version_ = static_cast<std::uint64_t>(std::time(nullptr)) * kVersionBlock;
    spdlog::error("event=state_versions_unreadable error=\"{}\" continuing_at={}", e.what(), first_version_);
  }
  reserve_versions(first_version_ + kVersionBlock);
}

StateStore::~StateStore() {
  if (lock_file_ >= 0) ::close(lock_file_);
}

void StateStore::reserve_versions(std::uint64_t limit) {
  write_file(directory_ / "versions.json", json{{"first_unused", limit}}.dump());
}

void StateStore::save(const SceneRecord& record) {
  const fs::path folder = directory_ / "scenes" / record.id;
  fs::create_directories(folder);
  std::string raw;
  json scene{{"format", kFormat},
             {"scene_id", record.id},
             {"geometry", to_json(record.geometry)},
             {"version", record.version},
             {"next_window_id", record.next_window_id},
             {"windows", json::array()}};
  for (const WindowRecord& w : record.windows) {
    json window{{"id", w.id}, {"version", w.version}, {"begin_m", w.begin_m}, {"end_m", w.end_m}};
    if (w.evidence) window["evidence"] = to_json(*w.evidence);
    scene["windows"].push_back(std::move(window));
  }
  if (record.explicit_modulus) {
    const ExplicitModulus& e = *record.explicit_modulus;
    scene["explicit_nodes"] = {e.x_m.size(), e.y_m.size()};
    append(raw, e.x_m), append(raw, e.y_m), append(raw, e.youngs_modulus_pa);
  } else {
    append(raw, record.map_modulus_pa), append(raw, record.map_states), append(raw, record.map_log_deviation);
    scene["cells"] = record.map_modulus_pa.size();
  }
  const std::string name = fmt::format("map-{}.raw", record.version);
  write_file(folder / name, raw);
  scene["map"] = {{"file", name}, {"checksum", checksum(raw)}};
  write_file(folder / "scene.json", scene.dump(1));
  for (const auto& entry : fs::directory_iterator(folder))  // what scene.json no longer names
    if (entry.path().filename() != name && entry.path().filename() != "scene.json") fs::remove(entry.path());
}

SceneRecord StateStore::load_scene(const fs::path& folder) const {
  const json scene = json::parse(read_file(folder / "scene.json"));
  const int format = scene.at("format");
  if (format < kFirstFormat || format > kFormat) throw std::runtime_error("unknown format");
  SceneRecord record;
  record.id = scene.at("scene_id");
  if (record.id != folder.filename()) throw std::runtime_error("scene_id is not the folder's name");
  record.geometry = geometry_from(scene.at("geometry"), limits_);
  record.version = scene.at("version");
  record.next_window_id = scene.at("next_window_id");
  for (const json& w : scene.at("windows"))
    record.windows.push_back({w.at("id"), w.at("version"), w.at("begin_m"), w.at("end_m"),
                              w.contains("evidence") ? evidence_from(w["evidence"]) : nullptr});
  check(record);
  const fs::path name = scene.at("map").at("file").get<std::string>();
  if (name.has_parent_path()) throw std::runtime_error("map.file is not a plain name");
  const std::string raw = read_file(folder / name);
  if (checksum(raw) != scene.at("map").at("checksum").get<std::string>())
    throw std::runtime_error("the map file does not match its checksum");
  std::string_view rest = raw;
  if (scene.contains("explicit_nodes")) {
    const std::size_t nx = scene["explicit_nodes"].at(0), ny = scene["explicit_nodes"].at(1);
    if (nx < 2 || ny < 2) throw std::runtime_error("explicit_nodes: at least 2 x 2");
    record.explicit_modulus = ExplicitModulus{take<double>(rest, nx), take<double>(rest, ny),
                                              take<double>(rest, (nx - 1) * (ny - 1))};
  } else {
    for (WindowRecord& w : record.windows)  // of an old format: nothing is known
      if (!w.evidence) w.evidence = std::make_shared<WindowEvidence>();
    record.map_modulus_pa = take<float>(rest, scene.at("cells"));
    record.map_states = take<CellState>(rest, scene.at("cells"));
    if (format > kFirstFormat) record.map_log_deviation = take<float>(rest, scene.at("cells"));
  }
  return record;
}

void StateStore::set_aside(const std::string& id, const std::string& why) {
  const fs::path folder = directory_ / "scenes" / id;
  const fs::path to =
      directory_ / "set-aside" / fmt::format("{}-{}", id, static_cast<std::int64_t>(std::time(nullptr)));
  std::error_code error;
  fs::create_directories(to.parent_path(), error);
  fs::rename(folder, to, error);
  spdlog::error("event=state_set_aside scene={} error=\"{}\" moved_to=\"{}\" moved={}", id, why, to.string(),
                !error);
}

std::vector<SceneRecord> StateStore::load() {
  std::vector<SceneRecord> records;
  std::vector<fs::path> folders;
  for (const auto& entry : fs::directory_iterator(directory_ / "scenes")) folders.push_back(entry.path());
  std::sort(folders.begin(), folders.end());
  for (const fs::path& folder : folders) try {
      records.push_back(load_scene(folder));
    } catch (const std::exception& e) {
      set_aside(folder.filename().string(), e.what());
    }
  return records;
}

void StateStore::remove(const std::string& id) {
  // Out of the way in one step, then away.
  const fs::path gone = directory_ / ("deleted-" + id);
  std::error_code error;
  fs::remove_all(gone, error);
  if (!fs::exists(directory_ / "scenes" / id)) return;
  fs::rename(directory_ / "scenes" / id, gone, error);
  if (error)
    throw std::runtime_error(fmt::format("--state: cannot delete {}: {}; it comes back with a restart",
                                         (directory_ / "scenes" / id).string(), error.message()));
  sync_folder(directory_ / "scenes");
  fs::remove_all(gone, error);
}

}  // namespace teletact::service
