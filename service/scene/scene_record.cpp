#include "service/scene/scene_record.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <climits>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <stdexcept>
#include <string_view>

#include "service/base/shown.h"
#include "service/scene/between_slices.h"
#include "service/scene/slices.h"

namespace teletact::service {

namespace fs = std::filesystem;
using nlohmann::json;

namespace {

constexpr std::size_t kMaxImageNodes = std::size_t{1} << 14;  // of a B-mode image, a side

// 1 had neither evidence nor deviations, 2 no slices, 3 none that state deviations, 4 no
// modes of these; they are still read. What has no slices is written as 2, what states no deviations of them
// as 3, no modes as 4.
constexpr std::uint64_t kFormat = 5, kWithoutModes = 4, kExactSlices = 3, kWithoutSlices = 2,
                        kFirstFormat = 1;

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
  if (count > 0) std::memcpy(values.data(), in.data(), count * sizeof(T));
  in.remove_prefix(count * sizeof(T));
  return values;
}

// A number of json may be any double, which no integer need hold.
std::uint64_t count_of(const json& number, const char* name) {
  if (!number.is_number_unsigned())
    throw std::runtime_error(fmt::format("{}: {} is not a count", name, number.dump()));
  return number.get<std::uint64_t>();
}

json to_json(const SceneGeometry& g) {
  const auto fixed = [](EdgeSupport e) { return e == EdgeSupport::kFixed; };
  return {{"width_m", g.width_m},
          {"depth_m", g.depth_m},
          {"poisson_ratio", g.poisson_ratio},
          {"thickness_m", g.thickness_m},
          {"linear", g.linear},
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
  g.linear = j.value("linear", false);  // earlier versions keep none
  g.supports = {edge("fixed_top"), edge("fixed_bottom"), edge("fixed_left"), edge("fixed_right")};
  validate(g, limits);
  return g;
}

json to_json(const WindowEvidence& e) {
  const auto number = [](double value) { return std::isfinite(value) ? value : 0; };  // json knows no other
  return {{"warnings", e.warnings},
          {"log_deviation", number(e.log_deviation)},
          {"correlation_m", number(e.correlation_m)},
          {"force_relative_deviation", number(e.force_relative_deviation)},
          {"area_relative_deviation", number(e.area_relative_deviation)},
          {"common_deviation", number(e.common_deviation)},
          {"background_modulus_pa", number(e.background_modulus_pa)},
          {"quality", number(e.quality)},
          {"measured_share", number(e.measured_share)}};
}

// Its grey values stand after the map; earlier versions, which know of none, read what is before.
json to_json(const BMode& image) {
  const ImageGrid& g = image.grid;
  return {
      {"nodes", {g.nx, g.ny}}, {"origin_m", {g.origin_x_m, g.origin_y_m}}, {"spacing_m", {g.dx_m, g.dy_m}}};
}

std::shared_ptr<const BMode> b_mode_from(const json& j, std::string_view& rest) {
  auto image = std::make_shared<BMode>();
  ImageGrid& g = image->grid;
  g = {count_of(j.at("nodes").at(0), "b_mode.nodes"),
       count_of(j.at("nodes").at(1), "b_mode.nodes"),
       j.at("origin_m").at(0),
       j.at("origin_m").at(1),
       j.at("spacing_m").at(0),
       j.at("spacing_m").at(1)};
  const bool placed = std::isfinite(g.origin_x_m) && std::isfinite(g.origin_y_m) && std::isfinite(g.dx_m) &&
                      std::isfinite(g.dy_m) && g.dx_m > 0 && g.dy_m > 0;
  if (g.nx < 2 || g.ny < 2 || g.nx > kMaxImageNodes || g.ny > kMaxImageNodes || !placed)
    throw std::runtime_error("b_mode: no grid of an image");
  image->grey = take<std::uint8_t>(rest, g.size());
  return image;
}

std::shared_ptr<const WindowEvidence> evidence_from(const json& j) {
  auto e = std::make_shared<WindowEvidence>();
  e->warnings = j.at("warnings").get<std::vector<std::string>>();
  e->log_deviation = j.at("log_deviation");
  e->correlation_m = j.value("correlation_m", 0.0);  // files of before have none
  e->force_relative_deviation = j.at("force_relative_deviation");
  e->area_relative_deviation = j.at("area_relative_deviation");
  e->background_modulus_pa = j.at("background_modulus_pa");
  e->quality = j.at("quality");
  e->measured_share = j.at("measured_share");
  // Deviations of before hold nothing of what all places share.
  const double of_force = std::hypot(e->force_relative_deviation, e->area_relative_deviation);
  e->common_deviation = j.value("common_deviation", of_force);
  if (!j.contains("common_deviation") && e->log_deviation > 0)
    e->log_deviation = std::hypot(e->log_deviation, of_force);
  return e;
}

// What a slice can have told: finite odds and lengths, and of no combination of its numbers less than no
// information, to rounding, nor a mean beyond what logarithms of lengths and moduli can be.
bool can_be_told(const ToldTissue& t) {
  constexpr double kRounding = 1e-13, kMost = 1e12;  // known to 1e-6 of it
  constexpr double kLargest = 20;                    // of a mean beside what is known beforehand
  constexpr double kLongestM = 10;
  const Eigen::Index n = t.load.size();
  if (!(t.log_likelihood <= 0) || !std::isfinite(t.log_likelihood) || t.information.size() != n * n)
    return false;
  for (const double length_m : {t.elevation_m, t.depth_m, t.beside_m})
    if (!(length_m >= 0 && length_m <= kLongestM)) return false;
  if ((t.elevation_m > 0) != (t.depth_m > 0)) return false;
  if (n == 0) return true;
  if (!(t.information.array().abs() <= kMost).all() || !t.load.allFinite()) return false;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> of(t.information);
  const Eigen::ArrayXd sizes = of.eigenvalues(), loads = of.eigenvectors().transpose() * t.load;
  return t.information.isApprox(t.information.transpose(), kRounding) &&
         (sizes >= -kRounding * sizes.maxCoeff()).all() &&
         (loads.abs() <= kLargest * (1 + sizes.max(0))).all();
}

// Their numbers are the map's last; earlier versions, which know of none, read what is before.
json to_json(const std::vector<ToldTissue>& tissues, std::string& raw) {
  json names = json::array();
  for (const ToldTissue& t : tissues) {
    names.push_back(
        {t.ends, t.slides, t.place, t.load.size(), json::array({t.elevation_m, t.depth_m, t.beside_m})});
    append(raw, std::vector{t.log_likelihood});
    append(raw, std::vector(t.load.begin(), t.load.end()));
    append(raw, std::vector(t.information.reshaped().begin(), t.information.reshaped().end()));
  }
  return names;
}

int kind_number(const json& number) {
  const bool fits = number.is_number_integer() && number >= INT_MIN && number <= INT_MAX;
  if (!fits) throw std::runtime_error("tissues: no number of a kind");
  return number.get<int>();
}

std::vector<ToldTissue> told_from(const json& names, std::string_view& rest) {
  constexpr std::size_t kMostNumbers = 16;  // of a tissue
  std::vector<ToldTissue> out;
  for (const json& name : names) {
    const std::size_t count = count_of(name.at(3), "tissues");
    if (count > kMostNumbers)
      throw std::runtime_error(fmt::format("tissues: {} numbers of one, more than a slice finds", count));
    const std::vector<double> numbers = take<double>(rest, 1 + count + count * count);
    const auto n = static_cast<Eigen::Index>(count);
    out.push_back({kind_number(name.at(0)), kind_number(name.at(1)), kind_number(name.at(2)), numbers[0],
                   Eigen::Map<const Eigen::MatrixXd>(numbers.data() + 1 + count, n, n),
                   Eigen::Map<const Eigen::VectorXd>(numbers.data() + 1, n)});
    if (name.size() > 4) {  // files of before have none
      const auto [elevation_m, depth_m, beside_m] = name[4].get<std::array<double, 3>>();
      out.back().elevation_m = elevation_m, out.back().depth_m = depth_m, out.back().beside_m = beside_m;
    }
    if (!can_be_told(out.back())) throw std::runtime_error("tissues: no slice finds such numbers");
  }
  return out;
}

// What is wrong with it costs these numbers, which slices tell anew, and not the scene.
ToldRecord told_slices(const json& scene, std::string_view rest) {
  constexpr std::size_t kMostWords = 1000;  // bytes
  ToldRecord out;
  if (scene.contains("tissues")) try {
      for (const json& slice : scene["tissues"])
        out.slices[slice.at(0).get<double>()] = told_from(slice.at(1), rest);
      if (const auto words = scene.find("told_words"); words != scene.end() && words->is_string())
        out.words = shown(words->get<std::string>(), kMostWords);
    } catch (const std::exception& error) {
      spdlog::warn("event=tissues_not_restored scene={} error=\"{}\"",
                   shown(scene.at("scene_id").get<std::string>()), shown(error.what(), 500));
      out = {};
    }
  return out;
}

// Files of before have none.
void require_checksum(json scene) {
  const auto stated = scene.find("checksum");
  if (stated == scene.end()) return;
  const std::string of_rest = stated->get<std::string>();
  scene.erase(stated);
  if (checksum(scene.dump()) != of_rest)
    throw std::runtime_error("the description does not match its checksum");
}

// What a whole file can still say wrong, after a hand has been at it. NaN fails too.
void check(const SceneRecord& record) {
  if (record.version > kLargestVersion) throw std::runtime_error("version: too large");
  std::set<std::uint64_t> ids;
  for (const WindowRecord& w : record.windows) {
    const double width_m = record.geometry.width_m;
    const bool placed =
        w.begin_m >= -kNodesSlack * width_m && w.begin_m < w.end_m && w.end_m <= 1.001 * width_m;
    if (!placed || w.id == 0 || w.version > record.version || !ids.insert(w.id).second)
      throw std::runtime_error(
          fmt::format("windows: {} [{}, {}) m of version {} cannot be", w.id, w.begin_m, w.end_m, w.version));
  }
}

}  // namespace

EncodedScene encoded(const SceneRecord& record) {
  std::string raw;
  json scene{{"format", kWithoutSlices},
             {"scene_id", record.id},
             {"geometry", to_json(record.geometry)},
             {"version", record.version},
             {"next_window_id", record.next_window_id},
             {"windows", json::array()}};
  for (const WindowRecord& w : record.windows) {
    json window{{"id", w.id}, {"version", w.version}, {"begin_m", w.begin_m}, {"end_m", w.end_m}};
    if (w.evidence) window["evidence"] = to_json(*w.evidence);
    if (w.b_mode) window["b_mode"] = to_json(*w.b_mode);
    scene["windows"].push_back(std::move(window));
  }
  if (record.explicit_modulus) {
    const ExplicitModulus& e = *record.explicit_modulus;
    scene["explicit_nodes"] = {e.x_m.size(), e.y_m.size()};
    if (e.solid()) scene["explicit_nodes"].push_back(e.z_m.size());
    if (!e.slices_m.empty()) scene["slices"] = e.slices_m.size(), scene["format"] = kExactSlices;
    if (!e.log_deviation.empty()) scene["log_deviation"] = true, scene["format"] = kWithoutModes;
    if (!e.log_modes.empty()) {
      scene["log_modes"] = json::array(), scene["format"] = kFormat;
      for (const std::vector<float>& modes : e.log_modes) scene["log_modes"].push_back(modes.size());
    }
    append(raw, e.x_m), append(raw, e.y_m), append(raw, e.z_m), append(raw, e.slices_m);
    append(raw, e.youngs_modulus_pa), append(raw, e.log_deviation);
    for (const std::vector<float>& modes : e.log_modes) append(raw, modes);
    for (const auto& [z_m, tissues] : record.told.slices)
      if (std::ranges::all_of(tissues, can_be_told)) scene["tissues"].push_back({z_m, to_json(tissues, raw)});
    if (!record.told.slices.empty()) scene["told_words"] = record.told.words;
  } else {
    append(raw, record.map_modulus_pa), append(raw, record.map_states), append(raw, record.map_log_deviation);
    scene["cells"] = record.map_modulus_pa.size();
    for (const WindowRecord& w : record.windows)
      if (w.b_mode) append(raw, w.b_mode->grey);
  }
  EncodedScene out;
  const std::string of_map = checksum(raw);  // slices may tell more between two saves of a version
  out.map_name = fmt::format("map-{}-{}.raw", record.version, of_map);
  scene["map"] = {{"file", out.map_name}, {"checksum", of_map}};
  out.map = std::move(raw);
  scene["checksum"] = checksum(scene.dump());
  out.description = scene.dump(1);
  return out;
}

SceneRecord decoded(const std::string& description,
                    const std::function<std::string(const std::string&)>& map_of, const Limits& limits) {
  const json scene = json::parse(description);
  const std::uint64_t format = count_of(scene.at("format"), "format");
  if (format < kFirstFormat || format > kFormat) throw std::runtime_error("unknown format");
  SceneRecord record;
  record.id = scene.at("scene_id");
  record.geometry = geometry_from(scene.at("geometry"), limits);
  record.version = count_of(scene.at("version"), "version");
  record.next_window_id = count_of(scene.at("next_window_id"), "next_window_id");
  for (const json& w : scene.at("windows"))
    record.windows.push_back({count_of(w.at("id"), "windows.id"),
                              count_of(w.at("version"), "windows.version"), w.at("begin_m"), w.at("end_m"),
                              w.contains("evidence") ? evidence_from(w["evidence"]) : nullptr});
  check(record);
  const fs::path name = scene.at("map").at("file").get<std::string>();
  if (name.has_parent_path()) throw std::runtime_error("map.file is not a plain name");
  const std::string raw = map_of(name.string());
  if (checksum(raw) != scene.at("map").at("checksum").get<std::string>())
    throw std::runtime_error("the map file does not match its checksum");
  std::string_view rest = raw;
  if (scene.contains("explicit_nodes")) {
    const auto nodes = [&](std::size_t axis) {
      return count_of(scene["explicit_nodes"].at(axis), "explicit_nodes");
    };
    const std::size_t nx = nodes(0), ny = nodes(1);
    const bool solid = scene["explicit_nodes"].size() > 2;
    const std::size_t nz = solid ? nodes(2) : 2;
    if (nx < 2 || ny < 2 || nz < 2) throw std::runtime_error("explicit_nodes: at least 2 each way");
    ExplicitModulus e;
    e.x_m = take<double>(rest, nx);
    e.y_m = take<double>(rest, ny);
    if (solid) e.z_m = take<double>(rest, nz);
    if (scene.contains("slices")) e.slices_m = take<double>(rest, count_of(scene["slices"], "slices"));
    e.youngs_modulus_pa = take<double>(rest, (nx - 1) * (ny - 1) * e.slices());
    if (scene.value("log_deviation", false)) e.log_deviation = take<double>(rest, e.youngs_modulus_pa.size());
    if (scene.contains("log_modes"))
      for (const json& count : scene["log_modes"])
        e.log_modes.push_back(take<float>(rest, count_of(count, "log_modes")));
    check_modulus(e, record.geometry, limits);
    e.hidden_log_variance = hidden_log_variance(e);
    record.explicit_modulus = std::move(e);
    record.told = told_slices(scene, rest);
  } else {
    for (WindowRecord& w : record.windows)  // of an old format: nothing is known
      if (!w.evidence) w.evidence = std::make_shared<WindowEvidence>();
    const std::size_t cells = count_of(scene.at("cells"), "cells");
    record.map_modulus_pa = take<float>(rest, cells);
    record.map_states = take<CellState>(rest, cells);
    if (format > kFirstFormat) record.map_log_deviation = take<float>(rest, cells);
    double common = 0;  // that the cells' deviations of before leave out
    for (const json& w : scene["windows"])
      if (w.contains("evidence") && !w["evidence"].contains("common_deviation"))
        common = std::max(common, evidence_from(w["evidence"])->common_deviation);
    for (float& deviation : record.map_log_deviation)
      deviation = static_cast<float>(std::hypot(deviation, common));
    for (std::size_t n = 0; n < record.windows.size(); ++n)
      if (const json& w = scene["windows"][n]; w.contains("b_mode"))
        record.windows[n].b_mode = b_mode_from(w["b_mode"], rest);
  }
  require_checksum(scene);  // last: what is wrong by itself is named
  return record;
}

}  // namespace teletact::service
