#include "client/recordings/set_output.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "client/acquire/map_output.h"
#include "client/files/netcdf.h"
#include "client/files/picture.h"
#include "client/files/vti.h"

namespace teletact::client {
namespace {

constexpr char kDisagree[] =
    "the pairs differ by more than they state: the probe or the tissue moved otherwise in some; look at each "
    "pair's own maps";

const v1::Grid& grid_of(const EstimatedPlace& place) {
  for (const EstimatedPair& pair : place.pairs)
    if (pair.refusal.empty()) return map_of(pair.outcome.maps, "youngs_modulus").grid();
  throw std::invalid_argument("no pair of the place was estimated");
}

MapNodes nodes_of(const v1::Grid& grid) {
  return {grid.size(0), grid.size(1), grid.spacing_m(0), grid.spacing_m(1)};
}

// Of what is stated of force and tissue the force's noise alone is another for each pair.
double shared_deviation(const EstimatedPair& pair) {
  const v1::ProbeForce& force = pair.acquisition.probe_force();
  const double common = pair.outcome.summary.youngs_modulus_common_log_std(),
               noise = common > 0 && pair.acquisition.has_probe_force()
                           ? force.force_std_n() / (force.force_n() - force.force_zero_n())
                           : 0;
  return std::sqrt(std::max(0.0, common * common - noise * noise));
}

PairModulus modulus_of(const EstimatedPair& pair) {
  PairModulus out{values_of(map_of(pair.outcome.maps, "youngs_modulus")),
                  values_of(map_of(pair.outcome.maps, "youngs_modulus_log_std")),
                  pair.outcome.summary.quality(), shared_deviation(pair)};
  const std::vector<float> valid = values_of(map_of(pair.outcome.maps, "valid"));
  if (valid.size() != out.log_modulus.size() || out.log_deviation.size() != out.log_modulus.size())
    throw std::runtime_error("the service sent maps of one pair on several grids");
  for (std::size_t n = 0; n < valid.size(); ++n)
    out.log_modulus[n] =
        valid[n] != 0 ? std::log(out.log_modulus[n]) : std::numeric_limits<float>::quiet_NaN();
  return out;
}

// "twice said" once, with how many pairs say it.
std::vector<std::string> warnings_of(const EstimatedPlace& place) {
  std::vector<std::pair<std::string, int>> counted;
  for (std::size_t p = 0; p < place.pairs.size(); ++p) {
    if (!place.left_out[p].empty()) continue;
    for (const std::string& warning : place.pairs[p].outcome.summary.warnings()) {
      // Numbers differ from pair to pair: what is alike up to the first is one warning.
      const auto head = [](const std::string& text) {
        return text.substr(0, text.find_first_of("0123456789"));
      };
      const auto same = std::find_if(counted.begin(), counted.end(),
                                     [&](const auto& c) { return head(c.first) == head(warning); });
      if (same == counted.end())
        counted.emplace_back(warning, 1);
      else
        ++same->second;
    }
  }
  std::vector<std::string> out;
  for (const auto& [warning, times] : counted)
    out.push_back(place.joined.used > 1 ? fmt::format("{} of {} pairs: {}", times, place.joined.used, warning)
                                        : warning);
  if (place.joined.differ) out.push_back(kDisagree);
  return out;
}

std::vector<std::string> assumptions(const EstimatedPlace& place) {
  std::vector<std::string> out;
  bool one_pre = true;
  for (const EstimatedPair& pair : place.pairs)
    one_pre = one_pre && pair.frames.pre == place.pairs.front().frames.pre &&
              pair.frames.pre_frame == place.pairs.front().frames.pre_frame;
  if (place.joined.used > 1) {
    out.emplace_back("all pairs are of one place: probe and tissue moved along the push alone");
    if (!one_pre)
      out.emplace_back(
          "the pairs' first frames differ: their maps are laid on each other as if the tissue had not been "
          "pressed between these frames");
    if (!place.absolute)
      out.emplace_back("the modulus is relative: the pairs' levels were matched by the median");
  }
  for (std::size_t p = 0; p < place.pairs.size(); ++p) {
    const v1::EstimateSummary& summary = place.pairs[p].outcome.summary;
    const std::string& model = summary.modulus_model();  // of a plane it says why the method was taken
    if (place.left_out[p].empty() && summary.modulus_method() == v1::MODULUS_METHOD_SOLID)
      out.push_back(place.pairs.size() > 1 ? fmt::format("pair {}: {}", p + 1, model) : model);
  }
  return out;
}

Panel panel(const v1::Grid& grid, std::string title, std::vector<float> values, bool in_pa) {
  Panel out;
  out.title = std::move(title);
  out.nx = grid.size(0), out.ny = grid.size(1);
  out.origin_x_m = grid.origin_m(0), out.origin_y_m = grid.origin_m(1);
  out.dx_m = grid.spacing_m(0), out.dy_m = grid.spacing_m(1);
  out.values = std::move(values);
  if (in_pa) out.unit = "kPa", out.factor = 1e-3;
  return out;
}

std::vector<float> moduli(const JoinedModulus& joined) {
  std::vector<float> out;
  for (const float log : joined.log_modulus) out.push_back(std::exp(log));
  return out;
}

// Of one plane or several.
struct Arrays {
  std::vector<float> modulus, deviation;
  std::vector<std::uint8_t> valid;
  void add(const JoinedModulus& joined) {
    for (const float log : joined.log_modulus) {
      const bool said = std::isfinite(log);
      modulus.push_back(said ? std::exp(log) : 0);
      valid.push_back(said);
    }
    for (const float d : joined.log_deviation) deviation.push_back(std::isfinite(d) ? d : 0);
  }
  void add_nothing(std::size_t points) {
    modulus.resize(modulus.size() + points), deviation.resize(deviation.size() + points);
    valid.resize(valid.size() + points);
  }
  std::vector<VtiArray> arrays() const {
    return {{"youngs_modulus", modulus, 1}, {"youngs_modulus_log_std", deviation, 1}, {"valid", valid, 1}};
  }
};

VtiGrid vti_grid(const v1::Grid& grid, std::size_t planes, double first_z_m, double pitch_m) {
  return {{grid.size(0), grid.size(1), planes},
          {grid.origin_m(0), grid.origin_m(1), first_z_m},
          {grid.spacing_m(0), grid.spacing_m(1), pitch_m}};
}

NetcdfAxis netcdf_axis(const v1::Grid& grid, int axis, const char* name) {
  return {name, grid.origin_m(axis), grid.spacing_m(axis), grid.size(axis)};
}

// The modulus of one plane or several, NaN where not valid, as the Python client names it.
NetcdfContent netcdf_content(const v1::Grid& grid, const std::optional<NetcdfAxis>& planes,
                             const Arrays& arrays, bool absolute) {
  NetcdfContent out;
  if (planes) out.axes.push_back(*planes);
  out.axes.push_back(netcdf_axis(grid, 1, "y"));
  out.axes.push_back(netcdf_axis(grid, 0, "x"));
  std::vector<std::string> axes;
  for (const NetcdfAxis& axis : out.axes) axes.push_back(axis.name);
  std::vector<NetcdfFlag> valid;
  for (const std::uint8_t flag : arrays.valid) valid.push_back({flag});
  const auto masked = [&](std::vector<float> values) {
    for (std::size_t i = 0; i < values.size(); ++i)
      if (arrays.valid[i] == 0) values[i] = std::numeric_limits<float>::quiet_NaN();
    return values;
  };
  out.variables = {{"valid", "1", axes, valid},
                   {"youngs_modulus", absolute ? "Pa" : "1", axes, masked(arrays.modulus)},
                   {"youngs_modulus_log_std", "1", axes, masked(arrays.deviation)}};
  out.attributes = {{"modulus_absolute", std::int64_t{absolute}}};
  return out;
}

nlohmann::json pair_json(const EstimatedPlace& place, std::size_t p) {
  const EstimatedPair& pair = place.pairs[p];
  const bool used = place.left_out[p].empty();
  nlohmann::json json{{"pre", pair.frames.pre.string()}, {"post", pair.frames.post.string()}, {"used", used}};
  if (pair.frames.pre_frame) json["pre_frame"] = *pair.frames.pre_frame;
  if (pair.frames.post_frame) json["post_frame"] = *pair.frames.post_frame;
  if (pair.frames.force_n) json["force_n"] = *pair.frames.force_n;
  if (!used) json["left_out"] = place.left_out[p];
  if (!pair.refusal.empty()) return json;
  const v1::EstimateSummary& summary = pair.outcome.summary;
  json["folder"] = fmt::format("pair-{}", p + 1);
  json["quality"] = summary.quality();
  json["mean_axial_strain"] = summary.mean_axial_strain();
  json["background"] = summary.background_modulus_pa();
  return json;
}

nlohmann::json place_json(const EstimatedPlace& place) {
  const JoinedModulus& joined = place.joined;
  nlohmann::json pairs = nlohmann::json::array();
  std::size_t estimated = 0;
  for (std::size_t p = 0; p < place.pairs.size(); ++p) {
    pairs.push_back(pair_json(place, p));
    if (!place.pairs[p].refusal.empty()) continue;
    const PairUse& use = joined.pairs.at(estimated++);
    if (use.left_out.empty()) pairs.back()["share"] = use.share, pairs.back()["level"] = use.level;
  }
  nlohmann::json json{{"pairs", pairs},
                      {"used", joined.used},
                      {"assumed", place.assumed},
                      {"warnings", place.warnings},
                      {"modulus",
                       {{"absolute", place.absolute},
                        {"background", place.background},
                        {"correlation_m", place.correlation_m},
                        {"unit", place.absolute ? "Pa" : "1 (relative)"}}}};
  if (joined.used > 1)
    json["log_std"] = {{"of_one_pair", joined.of_one},
                       {"pairs_differ_by", joined.scatter},
                       {"shared", joined.shared},
                       {"part_that_differs", joined.part}};
  if (place.z_m) json["z_m"] = *place.z_m;
  return json;
}

void finish(const std::filesystem::path& folder, nlohmann::json json, std::vector<std::string>& written,
            const v1::GetInfoResponse& info) {
  json["files"] = written;
  json["service"] = {
      {"build", info.build()}, {"device", info.device().name()}, {"driver", info.device().driver_version()}};
  write_file(folder / "estimate.json", json.dump(2) + "\n");
  written.emplace_back("estimate.json");
}

}  // namespace

EstimatedPlace join_place(std::optional<double> z_m, std::vector<EstimatedPair> pairs) {
  EstimatedPlace place;
  place.z_m = z_m;
  place.pairs = std::move(pairs);
  std::vector<PairModulus> maps;
  place.absolute = true;
  for (const EstimatedPair& pair : place.pairs) {
    if (!pair.refusal.empty()) continue;
    maps.push_back(modulus_of(pair));
    place.absolute = place.absolute && pair.outcome.summary.modulus_absolute();
    if (map_of(pair.outcome.maps, "youngs_modulus").grid().SerializeAsString() !=
        grid_of(place).SerializeAsString())
      throw std::runtime_error("the service sent the pairs' maps on several grids");
  }
  if (!maps.empty()) place.joined = join_moduli(nodes_of(grid_of(place)), maps, place.absolute);
  std::size_t estimated = 0;
  for (const EstimatedPair& pair : place.pairs)
    place.left_out.push_back(pair.refusal.empty() ? place.joined.pairs[estimated++].left_out : pair.refusal);
  for (std::size_t p = 0; p < place.pairs.size(); ++p)
    if (place.left_out[p].empty())
      place.correlation_m = std::max(place.correlation_m,
                                     double{place.pairs[p].outcome.summary.youngs_modulus_correlation_m()});
  std::vector<float> said;
  for (const float log : place.joined.log_modulus)
    if (std::isfinite(log)) said.push_back(log);
  if (!said.empty()) {
    const auto middle = said.begin() + static_cast<std::ptrdiff_t>(said.size() / 2);
    std::nth_element(said.begin(), middle, said.end());
    place.background = std::exp(*middle);
  }
  place.warnings = warnings_of(place);
  place.assumed = assumptions(place);
  return place;
}

std::vector<std::string> write_place(const std::filesystem::path& folder, const EstimatedPlace& place,
                                     const v1::GetInfoResponse& info) {
  const v1::Grid& grid = grid_of(place);
  require_writable_folder(folder);
  std::filesystem::remove(folder / "estimate.json");  // an earlier one's; it is written last
  std::vector<std::string> written;
  for (std::size_t p = 0; p < place.pairs.size(); ++p) {
    const EstimatedPair& pair = place.pairs[p];
    if (!pair.refusal.empty()) continue;
    const std::string own = fmt::format("pair-{}", p + 1);
    require_writable_folder(folder / own);
    for (const std::string& file : write_estimate(folder / own, pair.acquisition, pair.outcome,
                                                  {pair.frames.pre, pair.frames.post, pair.made, info}))
      written.push_back(own + "/" + file);
  }
  Arrays arrays;
  arrays.add(place.joined);
  write_vti(folder / "modulus.vti", vti_grid(grid, 1, place.z_m.value_or(0), 1), arrays.arrays());
  const std::vector<Panel> panels{panel(grid, "youngs modulus", moduli(place.joined), place.absolute),
                                  panel(grid, "youngs modulus log std", place.joined.log_deviation, false)};
  write_png(folder / "modulus.png", panels);
  written.insert(written.end(), {"modulus.vti", "modulus.png"});
  NetcdfContent content = netcdf_content(grid, {}, arrays, place.absolute);
  content.attributes.insert(content.attributes.end(), {{"background_modulus", place.background},
                                                       {"youngs_modulus_correlation_m", place.correlation_m},
                                                       {"warnings", place.warnings}});
  if (write_netcdf(folder / "modulus.nc", content)) written.emplace_back("modulus.nc");
  finish(folder, place_json(place), written, info);
  return written;
}

std::vector<std::string> write_volume(const std::filesystem::path& folder,
                                      const std::vector<EstimatedPlace>& places,
                                      const v1::GetInfoResponse& info) {
  const v1::Grid* grid = nullptr;
  for (const EstimatedPlace& place : places)
    if (place.joined.used > 0) grid = &grid_of(place);
  if (grid == nullptr) throw std::invalid_argument("no plane has a modulus");
  require_writable_folder(folder);
  std::filesystem::remove(folder / "estimate.json");
  std::vector<std::string> written;
  Arrays arrays;
  std::vector<Panel> panels;
  nlohmann::json slices = nlohmann::json::array();
  bool absolute = true;
  for (std::size_t k = 0; k < places.size(); ++k) {
    const EstimatedPlace& place = places[k];
    slices.push_back(place_json(place));
    if (place.joined.used == 0) {
      arrays.add_nothing(std::size_t{grid->size(0)} * grid->size(1));
      continue;
    }
    if (grid_of(place).SerializeAsString() != grid->SerializeAsString())
      throw std::runtime_error("the service sent the planes' maps on several grids");
    const std::string own = fmt::format("slice-{}", k + 1);
    slices.back()["folder"] = own;
    for (const std::string& file : write_place(folder / own, place, info))
      written.push_back(own + "/" + file);
    arrays.add(place.joined);
    absolute = absolute && place.absolute;
    panels.push_back(panel(*grid, fmt::format("z {:.4g} mm", 1e3 * place.z_m.value_or(0)),
                           moduli(place.joined), place.absolute));
  }
  const double first = places.front().z_m.value_or(0);
  const double pitch = places.size() > 1
                           ? (places.back().z_m.value_or(0) - first) / static_cast<double>(places.size() - 1)
                           : 1;
  write_vti(folder / "volume.vti", vti_grid(*grid, places.size(), first, pitch), arrays.arrays());
  PictureOptions options;
  options.columns = 3;
  write_png(folder / "volume.png", panels, options);
  written.insert(written.end(), {"volume.vti", "volume.png"});
  if (write_netcdf(folder / "volume.nc",
                   netcdf_content(*grid, NetcdfAxis{"z", first, pitch, places.size()}, arrays, absolute)))
    written.emplace_back("volume.nc");
  std::vector<std::string> assumed{
      "the planes are parallel, at the z stated; nothing is passed from plane to plane: in each the modulus "
      "is "
      "taken to be the same across it"};
  if (!absolute)
    assumed.emplace_back(
        "the modulus is relative to each plane's own median: planes are not comparable in level");
  finish(folder, {{"slices", slices}, {"assumed", assumed}}, written, info);
  return written;
}

}  // namespace teletact::client
