// A scene as it is kept, and what it looks like on disk: a description in JSON and one raw file of its map.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "service/imaging/modulus/tissue_extent.h"
#include "service/scene/geometry.h"
#include "service/scene/stitched_map.h"

namespace teletact::service {

// Room for ever, and for adding blocks without overflow.
constexpr std::uint64_t kLargestVersion = std::uint64_t{1} << 62;

struct WindowRecord {
  std::uint64_t id = 0, version = 0;
  double begin_m = 0, end_m = 0;
  std::shared_ptr<const WindowEvidence> evidence =
      nullptr;                                    // null: none was kept, or the modulus is explicit
  std::shared_ptr<const BMode> b_mode = nullptr;  // the same
};

// An explicit modulus with its own grid: nodes x_m, y_m and E per element, x fastest. Of a solid nodes z_m
// too, z slowest: E of plane slices, one in the middle of each element, or where slices_m says, increasing.
struct ExplicitModulus {
  std::vector<double> x_m, y_m, youngs_modulus_pa;
  std::vector<double> z_m = {}, slices_m = {};
  std::vector<double> log_deviation = {};  // standard deviation of ln E, as E; empty: exact
  // Of each slice what of that is wrong alike (ModulusSlice::log_modes); empty: of none.
  std::vector<std::vector<float>> log_modes = {};
  std::vector<double> hidden_log_variance = {};  // between_slices.h: found from the above, not kept
  bool solid() const { return !z_m.empty(); }
  std::size_t slices() const { return !solid() ? 1 : slices_m.empty() ? z_m.size() - 1 : slices_m.size(); }
  // Of a solid.
  double slice_m(std::size_t n) const { return slices_m.empty() ? (z_m[n] + z_m[n + 1]) / 2 : slices_m[n]; }
};

struct ToldRecord {
  std::map<double, std::vector<ToldTissue>> slices;  // by z, m
  std::string words;                                 // of the last that told
};

struct SceneRecord {
  std::string id;
  SceneGeometry geometry;
  std::uint64_t version = 0, next_window_id = 1;
  std::vector<WindowRecord> windows;
  // One of the two, or neither while nothing is published.
  std::optional<ExplicitModulus> explicit_modulus;
  ToldRecord told = {};  // to an explicit modulus: ToldSlices
  std::vector<float> map_modulus_pa;
  std::vector<CellState> map_states;
  std::vector<float> map_log_deviation;
};

struct EncodedScene {
  std::string description, map_name, map;
};
EncodedScene encoded(const SceneRecord&);

// `map_of`: gives the bytes of the map file of this name. Throws std::exception saying what is wrong with it.
SceneRecord decoded(const std::string& description,
                    const std::function<std::string(const std::string&)>& map_of, const Limits&);

}  // namespace teletact::service
