#include "client/acquire/map_output.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>

#include "client/acquire/modulus_names.h"
#include "client/acquire/recorded_frames.h"
#include "client/files/png.h"
#include "client/files/vti.h"

namespace teletact::client {
namespace {

// What goes into one file.
struct Group {
  const char* file;
  std::vector<const char*> maps;
};

const std::vector<Group> kGroups{
    {"displacement",
     {"axial_displacement", "lateral_displacement", "axial_displacement_std", "lateral_displacement_std"}},
    {"strain",
     {"axial_strain", "lateral_strain", "shear_strain", "axial_strain_std", "lateral_strain_std",
      "shear_strain_std"}},
    {"correlation", {"correlation"}},
    {"modulus", {"youngs_modulus", "youngs_modulus_log_std"}},
    {"b_mode", {"b_mode"}}};

bool on_one_grid(const v1::Map& map, const v1::Map* other) {
  return other && map.grid().SerializeAsString() == other->grid().SerializeAsString();
}

// How a map's numbers are shown: in a unit that people read.
struct Shown {
  std::string unit;
  double factor;
};

Shown shown(const v1::Map& map) {
  if (map.unit() == "Pa") return {"kPa", 1e-3};
  if (map.unit() == "m") return {"um", 1e6};
  if (map.name().find("strain") != std::string::npos) return {"%", 100};
  return {map.unit() == "1" ? "" : map.unit(), 1};
}

template <class T>
std::vector<float> values_as(const v1::Map& map) {
  std::size_t points = 1;
  for (const std::uint32_t size : map.grid().size()) points *= size;
  const std::string& bytes = map.values().data();
  if (map.grid().size_size() < 2 || bytes.size() != points * sizeof(T))
    throw std::runtime_error("the service sent map '" + map.name() + "' that does not fill its grid");
  std::vector<float> out(points);
  for (std::size_t i = 0; i < out.size(); ++i) {
    T value;
    std::memcpy(&value, bytes.data() + i * sizeof(T), sizeof(T));
    out[i] = static_cast<float>(value);
  }
  return out;
}

const v1::Map* find_map(const std::vector<v1::Map>& maps, const std::string& name) {
  for (const v1::Map& map : maps)
    if (map.name() == name) return &map;
  return nullptr;
}

VtiGrid vti_grid(const v1::Grid& grid) {
  VtiGrid out;
  for (int axis = 0; axis < grid.size_size() && axis < 3; ++axis) {
    out.size[axis] = grid.size(axis);
    out.origin_m[axis] = grid.origin_m(axis);
    out.spacing_m[axis] = grid.spacing_m(axis);
  }
  return out;
}

Panel panel_of(const v1::Map& map, const std::vector<float>& valid) {
  Panel panel;
  const Shown how = shown(map);
  panel.title = map.name();
  for (char& c : panel.title)
    if (c == '_') c = ' ';
  panel.nx = map.grid().size(0);
  panel.ny = map.grid().size(1);
  panel.origin_x_m = map.grid().origin_m(0);
  panel.origin_y_m = map.grid().origin_m(1);
  panel.dx_m = map.grid().spacing_m(0);
  panel.dy_m = map.grid().spacing_m(1);
  panel.values = values_of(map);
  panel.unit = how.unit;
  panel.factor = how.factor;
  if (!valid.empty() && map.name() != "correlation") {
    for (std::size_t i = 0; i < valid.size(); ++i)
      if (valid[i] == 0) panel.values[i] = std::numeric_limits<float>::quiet_NaN();
    if (std::find(valid.begin(), valid.end(), 0) != valid.end()) panel.title += " (grey: not valid)";
  }
  return panel;
}

// What was asked for; the service chose where nothing was.
template <class Value>
std::string asked_for(const std::map<std::string, Value>& names, Value asked) {
  for (const auto& [name, value] : names)
    if (value == asked) return name;
  return "the service's choice";
}

nlohmann::json summary_json(const v1::Acquisition& acquisition, const EstimateOutcome& outcome) {
  const v1::EstimateSummary& summary = outcome.summary;
  nlohmann::json stages = nlohmann::json::object();
  for (const v1::StageTime& stage : summary.stages()) stages[stage.stage() + "_s"] = stage.seconds();
  nlohmann::json json{
      {"modulus",
       {{"absolute", summary.modulus_absolute()},
        {"background", summary.background_modulus_pa()},
        {"correlation_m", summary.youngs_modulus_correlation_m()},
        {"unit", summary.modulus_absolute() ? "Pa" : "1 (relative: no force was given)"},
        {"method", name_of(summary.modulus_method())},
        {"asked_for", asked_for(modulus_methods(), acquisition.modulus_method())},
        {"time_limit_s", acquisition.modulus_time_limit_s()},
        {"plane", asked_for(plane_conditions(), acquisition.plane())},
        {"model", summary.modulus_model()},
        {"converged", summary.modulus_converged()},
        {"iterations", summary.modulus_iterations()}}},
      {"warnings", std::vector<std::string>(summary.warnings().begin(), summary.warnings().end())},
      {"median_correlation", summary.median_correlation()},
      {"quality", summary.quality()},
      {"valid_fraction", summary.valid_fraction()},
      {"mean_axial_strain", summary.mean_axial_strain()},
      {"stages", stages},
      {"acquisition",
       {{"sample_count", acquisition.sample_count()},
        {"line_count", acquisition.line_count()},
        {"center_frequency_hz", acquisition.center_frequency_hz()},
        {"sampling_frequency_hz", acquisition.sampling_frequency_hz()},
        {"sound_speed_m_s", acquisition.sound_speed_m_s()},
        {"line_pitch_m", acquisition.line_pitch_m()},
        {"first_sample_depth_m", acquisition.first_sample_depth_m()},
        {"max_strain", acquisition.max_strain()},
        {"poisson_ratio", acquisition.poisson_ratio()},
        {"frame", acquisition.displacement_frame() == v1::DISPLACEMENT_FRAME_LAB ? "LAB" : "PROBE"}}}};
  const TissueExtent tissue = tissue_extent(acquisition);
  const auto stated = [](double length_m) -> nlohmann::json {
    if (length_m > 0) return length_m;
    return nullptr;
  };
  json["tissue"] = {{"width_m", stated(tissue.width_m)},
                    {"width_assumed", tissue.width_assumed},
                    {"depth_m", stated(tissue.depth_m)},
                    {"depth_assumed", tissue.depth_assumed}};
  if (acquisition.has_probe_force())
    json["acquisition"]["probe_force"] = {{"force_n", acquisition.probe_force().force_n()},
                                          {"contact_area_m2", acquisition.probe_force().contact_area_m2()}};
  if (!outcome.maps.empty()) {
    const v1::Grid& grid = outcome.maps.front().grid();
    json["grid"] = {{"size", std::vector<std::uint32_t>(grid.size().begin(), grid.size().end())},
                    {"origin_m", std::vector<double>(grid.origin_m().begin(), grid.origin_m().end())},
                    {"spacing_m", std::vector<double>(grid.spacing_m().begin(), grid.spacing_m().end())}};
  }
  return json;
}

}  // namespace

void require_writable_folder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error)
    throw FileError(folder, "cannot be created (" + error.message() + "); give another folder with --out");
  const std::filesystem::path probe = folder / ".teletact-writable";
  const bool written = static_cast<bool>(std::ofstream(probe) << 'x' << std::flush);
  std::filesystem::remove(probe, error);
  if (!written) throw FileError(folder, "cannot be written; give another folder with --out");
}

const v1::Map& map_of(const std::vector<v1::Map>& maps, const std::string& name) {
  for (const v1::Map& map : maps)
    if (map.name() == name) return map;
  throw ServiceError(grpc::StatusCode::INTERNAL, "Estimate: the service sent no map '" + name + "'");
}

std::vector<float> values_of(const v1::Map& map) {
  switch (map.values().dtype()) {
    case v1::DATA_TYPE_INT16:
      return values_as<std::int16_t>(map);
    case v1::DATA_TYPE_FLOAT32:
      return values_as<float>(map);
    case v1::DATA_TYPE_FLOAT64:
      return values_as<double>(map);
    case v1::DATA_TYPE_UINT8:
      return values_as<std::uint8_t>(map);
    default:
      throw std::runtime_error("the service sent a map of unknown data type");
  }
}

std::vector<std::string> write_estimate(const std::filesystem::path& folder,
                                        const v1::Acquisition& acquisition, const EstimateOutcome& outcome,
                                        const EstimateSource& source) {
  const std::filesystem::path summary = folder / "estimate.json";
  std::filesystem::remove(summary);  // an earlier estimate's; what is cut short from here on has none
  const v1::Map* valid_map = find_map(outcome.maps, "valid");
  const std::vector<float> of_window = valid_map ? values_of(*valid_map) : std::vector<float>{};
  std::vector<std::string> written;
  for (const Group& group : kGroups) {
    std::vector<VtiArray> arrays;
    std::vector<Panel> panels;
    std::optional<VtiGrid> grid;
    std::vector<float> valid;  // where the maps lie on its grid
    for (const char* name : group.maps) {
      const v1::Map* map = find_map(outcome.maps, name);
      if (map == nullptr) continue;
      grid = vti_grid(map->grid());
      valid = on_one_grid(*map, valid_map) ? of_window : std::vector<float>{};
      arrays.push_back({map->name(), values_of(*map), 1});
      panels.push_back(panel_of(*map, valid));
    }
    if (!grid) continue;
    if (!valid.empty()) arrays.push_back({"valid", std::vector<std::uint8_t>(valid.begin(), valid.end()), 1});
    const std::string file = group.file;
    write_vti(folder / (file + ".vti"), *grid, arrays);
    write_png(folder / (file + ".png"), panels);
    written.push_back(file + ".vti");
    written.push_back(file + ".png");
  }
  nlohmann::json json = summary_json(acquisition, outcome);
  json["files"] = written;
  json["source"] = {{"pre", source.pre}, {"post", source.post}};
  if (!source.made.empty()) json["source"]["made"] = source.made;
  json["service"] = {{"build", source.info.build()},
                     {"device", source.info.device().name()},
                     {"driver", source.info.device().driver_version()}};
  write_file(summary, json.dump(2) + "\n");
  written.push_back(summary.filename());
  return written;
}

}  // namespace teletact::client
