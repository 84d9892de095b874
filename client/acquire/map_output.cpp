#include "client/acquire/map_output.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>

#include "client/acquire/modulus_names.h"
#include "client/acquire/recorded_frames.h"
#include "client/files/netcdf.h"
#include "client/files/picture.h"
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

Shown unit_of(const v1::Map& map) {
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
  const int axes = map.grid().size_size();
  if (axes < 2 || axes > 3 || map.grid().origin_m_size() != axes || map.grid().spacing_m_size() != axes ||
      bytes.size() != points * sizeof(T))
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
  const Shown how = unit_of(map);
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
  panel.grey = map.name() == "b_mode";
  if (!valid.empty() && map.name() != "correlation") {
    for (std::size_t i = 0; i < valid.size(); ++i)
      if (valid[i] == 0) panel.values[i] = std::numeric_limits<float>::quiet_NaN();
    if (std::find(valid.begin(), valid.end(), 0) != valid.end()) panel.title += " (grey: not valid)";
  }
  return panel;
}

// The axes of a map, the slowest first; those of another grid than the window's bear the map's name.
std::vector<NetcdfAxis> netcdf_axes(const v1::Map& map, const std::string& suffix) {
  constexpr std::array kNames{"x", "y", "z"};
  std::vector<NetcdfAxis> axes;
  for (int axis = map.grid().size_size() - 1; axis >= 0; --axis)
    axes.push_back({kNames.at(static_cast<std::size_t>(axis)) + suffix, map.grid().origin_m(axis),
                    map.grid().spacing_m(axis), map.grid().size(axis)});
  return axes;
}

NetcdfVariable netcdf_variable(const v1::Map& map, const std::vector<NetcdfAxis>& axes,
                               const std::vector<float>& valid) {
  NetcdfVariable out{map.name(), map.unit(), {}, {}};
  for (const NetcdfAxis& axis : axes) out.axes.push_back(axis.name);
  std::vector<float> values = values_of(map);
  if (map.name() == "valid") {
    std::vector<NetcdfFlag> flags;
    flags.reserve(values.size());
    for (const float value : values) flags.push_back({static_cast<std::uint8_t>(value != 0)});
    out.values = std::move(flags);
  } else if (map.values().dtype() == v1::DATA_TYPE_UINT8) {
    out.values = std::vector<std::uint8_t>(values.begin(), values.end());
  } else {
    if (map.name() != "correlation")
      for (std::size_t i = 0; i < valid.size(); ++i)
        if (valid[i] == 0) values[i] = std::numeric_limits<float>::quiet_NaN();
    out.values = std::move(values);
  }
  return out;
}

// As the Python client's estimate() has them.
std::vector<std::pair<std::string, NetcdfAttribute>> netcdf_attributes(const v1::EstimateSummary& summary) {
  std::vector<std::string> stages;
  std::vector<double> seconds;
  for (const v1::StageTime& stage : summary.stages())
    stages.push_back(stage.stage()), seconds.push_back(stage.seconds());
  std::vector<std::pair<std::string, NetcdfAttribute>> out{
      {"warnings", std::vector<std::string>(summary.warnings().begin(), summary.warnings().end())},
      {"modulus_absolute", std::int64_t{summary.modulus_absolute()}},
      {"background_modulus", summary.background_modulus_pa()},
      {"modulus_method", name_of(summary.modulus_method())},
      {"modulus_converged", std::int64_t{summary.modulus_converged()}},
      {"modulus_iterations", std::int64_t{summary.modulus_iterations()}},
      {"modulus_model", summary.modulus_model()},
      {"median_correlation", summary.median_correlation()},
      {"valid_fraction", summary.valid_fraction()},
      {"mean_axial_strain", summary.mean_axial_strain()},
      {"quality", summary.quality()},
      {"stages", stages},
      {"stages_s", seconds}};
  if (summary.has_youngs_modulus_correlation_m())
    out.emplace_back("youngs_modulus_correlation_m", summary.youngs_modulus_correlation_m());
  if (summary.has_youngs_modulus_log_std()) {
    out.emplace_back("youngs_modulus_log_std", summary.youngs_modulus_log_std());
    out.emplace_back("youngs_modulus_common_log_std", summary.youngs_modulus_common_log_std());
  }
  return out;
}

NetcdfContent netcdf_content(const EstimateOutcome& outcome, const std::vector<float>& valid) {
  NetcdfContent out;
  std::vector<const char*> names{"valid"};
  for (const Group& group : kGroups) names.insert(names.end(), group.maps.begin(), group.maps.end());
  const v1::Map* window = find_map(outcome.maps, "valid");
  if (window != nullptr) out.axes = netcdf_axes(*window, "");
  for (const char* name : names) {
    const v1::Map* map = find_map(outcome.maps, name);
    if (map == nullptr) continue;
    const bool of_window = on_one_grid(*map, window);
    const std::vector<NetcdfAxis> axes = netcdf_axes(*map, of_window ? "" : "_" + map->name());
    if (!of_window) out.axes.insert(out.axes.end(), axes.begin(), axes.end());
    out.variables.push_back(netcdf_variable(*map, axes, of_window ? valid : std::vector<float>{}));
  }
  out.attributes = netcdf_attributes(outcome.summary);
  return out;
}

// What was asked for; the service chose where nothing was.
template <class Value>
std::string asked_for(const std::map<std::string, Value>& names, Value asked) {
  for (const auto& [name, value] : names)
    if (value == asked) return name;
  return "the service's choice";
}

// What is stated, by its names in the contract, where it is not there yet.
void add_numbers(const google::protobuf::Message& message, nlohmann::json& to) {
  std::vector<const google::protobuf::FieldDescriptor*> stated;
  message.GetReflection()->ListFields(message, &stated);
  for (const auto* field : stated)
    if (field->cpp_type() == field->CPPTYPE_DOUBLE && !to.contains(field->name()))
      to[field->name()] = message.GetReflection()->GetDouble(message, field);
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
        {"log_std", summary.youngs_modulus_log_std()},
        {"common_log_std", summary.youngs_modulus_common_log_std()},
        {"unit", summary.modulus_absolute() ? "Pa" : "1 (relative: neither force nor pad was given)"},
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
  json["tissue"] = {{"width_m", stated(tissue.width_m)}, {"depth_m", stated(tissue.depth_m)}};
  if (acquisition.plane() != v1::PLANE_CONDITION_SOLID)  // the model says what was assumed of a solid
    json["tissue"].update({{"width_assumed", tissue.width_assumed}, {"depth_assumed", tissue.depth_assumed}});
  add_numbers(acquisition, json["acquisition"]);
  if (acquisition.has_probe_force())
    add_numbers(acquisition.probe_force(), json["acquisition"]["probe_force"]);
  if (!outcome.maps.empty()) {
    const v1::Grid& grid = outcome.maps.front().grid();
    json["grid"] = {{"size", std::vector<std::uint32_t>(grid.size().begin(), grid.size().end())},
                    {"origin_m", std::vector<double>(grid.origin_m().begin(), grid.origin_m().end())},
                    {"spacing_m", std::vector<double>(grid.spacing_m().begin(), grid.spacing_m().end())}};
  }
  return json;
}

}  // namespace

const v1::Map& map_of(const std::vector<v1::Map>& maps, std::string_view name) {
  for (const v1::Map& map : maps)
    if (map.name() == name) return map;
  throw ServiceError(grpc::StatusCode::INTERNAL,
                     "Estimate: the service sent no map '" + std::string(name) + "'");
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
      arrays.push_back({map->name(), values_of(*map), 1});
      grid = vti_grid(map->grid());
      valid = on_one_grid(*map, valid_map) ? of_window : std::vector<float>{};
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
  if (write_netcdf(folder / "maps.nc", netcdf_content(outcome, of_window))) written.emplace_back("maps.nc");
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
