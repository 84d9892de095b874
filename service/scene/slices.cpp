#include "service/scene/slices.h"

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <utility>

#include "service/base/choices.h"
#include "service/base/force_budget.h"
#include "service/base/squared.h"
#include "service/scene/between_slices.h"
#include "service/scene/errors.h"

namespace teletact::service {

namespace {

void check_nodes(const std::string& field, const std::vector<double>& given_m,
                 const std::vector<double>& own_m) {
  const double slack_m = 1e-6 * (own_m.back() - own_m.front()) / static_cast<double>(own_m.size() - 1);
  const auto same = [slack_m](double a, double b) { return std::abs(a - b) <= slack_m; };
  if (!given_m.empty() && !std::equal(given_m.begin(), given_m.end(), own_m.begin(), own_m.end(), same))
    throw std::invalid_argument(fmt::format(
        "{}: not the solid's own {} nodes from {} to {} m; resample the slice onto them, or leave it out",
        field, own_m.size(), own_m.front(), own_m.back()));
}

// `deviation`: of ln E, what the changes are a part of.
void check_log_modes(const std::string& field, const std::vector<float>& modes,
                     const std::vector<double>& deviation) {
  if (modes.empty()) return;
  if (deviation.empty() || modes.size() % deviation.size() != 0 ||
      modes.size() / deviation.size() > kMaxLogModes)
    throw std::invalid_argument(
        fmt::format("{}: {} values for {} deviations; give at most {} changes of each, with the deviations",
                    field, modes.size(), deviation.size(), kMaxLogModes));
  constexpr double kRounding = 1e-3;
  std::vector<double> variance(deviation.size(), 0.0);
  for (std::size_t n = 0; n < modes.size(); ++n) {
    const std::size_t element = n % deviation.size();
    variance[element] += squared(modes[n]);
    if (!(variance[element] <= squared((1 + kRounding) * deviation[element] + kRounding)))
      throw std::invalid_argument(fmt::format(
          "{}[{}]: {}: the changes of an element are finite and, their squares added, at most the square of "
          "its deviation, {}",
          field, n, modes[n], deviation[element]));
  }
}

void check(const std::string& field, const ModulusSlice& slice, const ExplicitModulus& grid) {
  if (!(slice.z_m >= grid.z_m.front() && slice.z_m <= grid.z_m.back()))
    throw std::invalid_argument(
        fmt::format("{}.pose.origin_m[2]: {} m is beside the solid, which reaches "
                    "from {} to {} m",
                    field, slice.z_m, grid.z_m.front(), grid.z_m.back()));
  check_nodes(field + ".modulus.x_m", slice.x_m, grid.x_m);
  check_nodes(field + ".modulus.y_m", slice.y_m, grid.y_m);
  const std::size_t elements = (grid.x_m.size() - 1) * (grid.y_m.size() - 1);
  if (slice.youngs_modulus_pa.size() != elements)
    throw std::invalid_argument(fmt::format("{}.modulus.youngs_modulus_pa: {} values for {} elements", field,
                                            slice.youngs_modulus_pa.size(), elements));
  check_moduli(field + ".modulus.youngs_modulus_pa", slice.youngs_modulus_pa);
  const std::vector<double>& deviation = slice.log_deviation;
  const std::string of_deviation = field + ".youngs_modulus_log_std";
  if (!deviation.empty() && deviation.size() != elements)
    throw std::invalid_argument(
        fmt::format("{}: {} values for {} elements", of_deviation, deviation.size(), elements));
  constexpr double kMax = 10;
  for (std::size_t n = 0; n < deviation.size(); ++n)
    if (!(deviation[n] >= 0 && deviation[n] <= kMax))
      throw std::invalid_argument(
          fmt::format("{}[{}]: {} is not within [0, {}]", of_deviation, n, deviation[n], kMax));
  check_log_modes(field + ".youngs_modulus_log_modes", slice.log_modes, deviation);
}

// Puts a slice's values among the others', at `slice` of theirs.
void put(std::vector<double>& all, std::size_t slice, const std::vector<double>& own, bool in_its_place) {
  const auto to = all.begin() + static_cast<std::ptrdiff_t>(slice * own.size());
  if (in_its_place)
    std::copy(own.begin(), own.end(), to);
  else
    all.insert(to, own.begin(), own.end());
}

// Puts it there; where one states deviations the others are exact.
void put(ExplicitModulus& all, std::size_t at, const ModulusSlice& slice, bool in_its_place) {
  if (!slice.log_deviation.empty() || !all.log_deviation.empty()) {
    all.log_deviation.resize(all.youngs_modulus_pa.size());
    std::vector<double> own = slice.log_deviation;
    own.resize(slice.youngs_modulus_pa.size());
    put(all.log_deviation, at, own, in_its_place);
  }
  put(all.youngs_modulus_pa, at, slice.youngs_modulus_pa, in_its_place);
  std::vector<std::vector<float>>& modes = all.log_modes;
  if (modes.empty() && slice.log_modes.empty()) return;
  const std::size_t plane = slice.youngs_modulus_pa.size(), slices = all.youngs_modulus_pa.size() / plane;
  modes.resize(in_its_place ? slices : slices - 1);
  if (in_its_place)
    modes[at] = slice.log_modes;
  else
    modes.insert(modes.begin() + static_cast<std::ptrdiff_t>(at), slice.log_modes);
}

double nearest_slice_m(const ExplicitModulus& e, double z_m) {
  double nearest_m = HUGE_VAL;
  for (const double slice_m : e.slices_m) nearest_m = std::min(nearest_m, std::abs(slice_m - z_m));
  return nearest_m;
}

double spacing_z_m(const ExplicitModulus& e) {
  return (e.z_m.back() - e.z_m.front()) / static_cast<double>(e.z_m.size() - 1);
}

// In which it lies, or the nearest.
std::size_t element(const std::vector<double>& nodes_m, double at_m) {
  const auto above = std::upper_bound(nodes_m.begin() + 1, nodes_m.end() - 1, at_m);
  return static_cast<std::size_t>(above - nodes_m.begin()) - 1;
}

// Of what a slice states, as a contact feels it, the variance of what is wrong in many places.
double alike_variance(const ExplicitModulus& e, std::size_t slice, const FeltElements& felt) {
  const std::size_t plane = e.log_deviation.size() / e.slices();
  const double* deviation = e.log_deviation.data() + slice * plane;
  double variance = 0;
  if (e.log_modes.empty() || e.log_modes[slice].empty())
    felt.each([&](std::size_t n, double share) { variance += share * squared(deviation[n]); });
  else
    for (auto mode = e.log_modes[slice].begin(); mode != e.log_modes[slice].end();
         mode += std::ptrdiff_t(plane)) {
      double change = 0;
      felt.each([&](std::size_t n, double share) { change += share * mode[std::ptrdiff_t(n)]; });
      variance += squared(change);
    }
  return variance;
}

// The standard deviation of the rest in each element, row by row of those that are felt.
std::vector<double> by_place(const ExplicitModulus& e, std::size_t slice, const FeltElements& felt) {
  const std::size_t plane = e.log_deviation.size() / e.slices();
  const std::vector<float>& modes = e.log_modes[slice];
  std::vector<double> out;
  felt.each_row([&](std::size_t first, const double*, std::size_t columns) {
    const auto count = static_cast<Eigen::Index>(columns);
    Eigen::ArrayXd left =
        Eigen::Map<const Eigen::ArrayXd>(&e.log_deviation[slice * plane + first], count).square();
    for (std::size_t mode = first; mode < modes.size(); mode += plane)
      left -= Eigen::Map<const Eigen::ArrayXf>(&modes[mode], count).cast<double>().square();
    left = left.max(0).sqrt();
    out.insert(out.end(), left.begin(), left.end());
  });
  return out;
}

double stated_variance(const ExplicitModulus& e, const FeltElements& felt, const FeltPlace& place) {
  constexpr double kLeast = 0.02;  // of a contact: slices that tell less are not felt
  if (e.log_deviation.empty()) return 0;
  const Between at = between(e, place.z_m);
  const std::vector<std::vector<double>> shares = felt.told_by(e.slices_m);
  const std::size_t columns = e.x_m.size() - 1;
  std::vector<double> rows(e.y_m.size() - 1, 0.0);
  felt.each([&](std::size_t element, double share) { rows[element / columns] += share; });
  struct FeltSlice {
    std::size_t n;
    double like_last;               // correlation with the one before
    std::vector<double> deviation;  // that is known place by place
  };
  double alike = 0;
  std::vector<FeltSlice> slices;
  for (std::size_t n = 0; n < shares.size(); ++n) {
    const double near = n == at.before ? 1 - at.share : n == at.after ? at.share : 0;
    if (near == 0 && std::inner_product(rows.begin(), rows.end(), shares[n].begin(), 0.0) < kLeast) continue;
    if (near > 0) alike += near * alike_variance(e, n, felt);
    if (e.log_modes.empty() || e.log_modes[n].empty()) continue;
    const double from_last_m = slices.empty() ? 0 : e.slices_m[n] - e.slices_m[slices.back().n];
    slices.push_back({n, std::exp(-from_last_m / choices::kLocalCorrelation), by_place(e, n, felt)});
  }
  double variance = 0;
  std::size_t row = 0, nth = 0;
  felt.each_row([&](std::size_t, const double* share, std::size_t count) {
    for (std::size_t n = 0; n < count; ++n, ++nth) {
      double before = 0;  // of the slices before, what is wrong as this one is
      for (const FeltSlice& slice : slices) {
        const double own = shares[slice.n][row] * slice.deviation[nth];
        before *= slice.like_last;
        variance += share[n] * own * (own + 2 * before);
        before += own;
      }
    }
    ++row;
  });
  return alike + left_of_local(place.radius_m, choices::kLocalCorrelation) * variance;
}

void require_room(const ExplicitModulus& grid, std::size_t slices, const Limits& limits) {
  const std::size_t plane = (grid.x_m.size() - 1) * (grid.y_m.size() - 1);
  if (slices > limits.max_solid_elements / plane)
    throw Error(ErrorKind::kExhausted,
                fmt::format("slices: {} of {} elements, at most {} in all are allowed; use a coarser grid or "
                            "fewer slices",
                            slices, plane, limits.max_solid_elements));
}

}  // namespace

void check_moduli(const std::string& field, const std::vector<double>& youngs_modulus_pa) {
  constexpr double kSoftest = 1, kHardest = 1e12;
  for (std::size_t n = 0; n < youngs_modulus_pa.size(); ++n)
    if (const double e = youngs_modulus_pa[n]; !(e >= kSoftest && e <= kHardest))
      throw std::invalid_argument(fmt::format("{}[{}]: {} Pa; a modulus must be within [{}, {}] Pa", field, n,
                                              e, kSoftest, kHardest));
}

ExplicitModulus stacked(ExplicitModulus grid, const std::vector<ModulusSlice>& slices, const Limits& limits) {
  if (slices.empty()) throw std::invalid_argument("slices: none; give at least one");
  require_room(grid, slices.size(), limits);
  const auto name = [](std::size_t n) { return fmt::format("slices[{}]", n); };
  for (std::size_t n = 0; n < slices.size(); ++n) check(name(n), slices[n], grid);
  std::vector<std::size_t> by_z(slices.size());
  std::iota(by_z.begin(), by_z.end(), 0);
  std::sort(by_z.begin(), by_z.end(),
            [&](std::size_t a, std::size_t b) { return slices[a].z_m < slices[b].z_m; });
  for (const std::size_t n : by_z) {
    const ModulusSlice& slice = slices[n];
    if (!grid.slices_m.empty() && slice.z_m - grid.slices_m.back() < kSameSliceM)
      throw std::invalid_argument(
          fmt::format("{}.pose.origin_m[2]: {} m has another slice already; give one for each place", name(n),
                      slice.z_m));
    put(grid, grid.slices_m.size(), slice, false);
    grid.slices_m.push_back(slice.z_m);
  }
  grid.hidden_log_variance = hidden_log_variance(grid);
  return grid;
}

GrownModulus with_slice(const ExplicitModulus& old, const ModulusSlice& slice, const Limits& limits) {
  check("slice", slice, old);
  GrownModulus out{old, 0};
  std::vector<double>& places = out.modulus.slices_m;
  if (places.empty())
    for (std::size_t n = 0; n < old.slices(); ++n) places.push_back(old.slice_m(n));
  const auto at = std::lower_bound(places.begin(), places.end(), slice.z_m - kSameSliceM);
  out.slice = static_cast<std::size_t>(at - places.begin());
  const bool in_its_place = at != places.end() && *at - slice.z_m < kSameSliceM;
  if (!in_its_place) require_room(old, places.size() + 1, limits);
  put(out.modulus, out.slice, slice, in_its_place);
  if (!in_its_place) places.insert(at, slice.z_m);
  out.modulus.hidden_log_variance = hidden_log_variance(out.modulus);
  return out;
}

bool extruded(const ExplicitModulus& e) {
  const auto second =
      e.youngs_modulus_pa.begin() + static_cast<std::ptrdiff_t>((e.x_m.size() - 1) * (e.y_m.size() - 1));
  return std::equal(second, e.youngs_modulus_pa.end(), e.youngs_modulus_pa.begin());
}

Between between(const ExplicitModulus& e, double z_m) {
  constexpr double kRounding = 1e-9;
  Between at;
  const std::size_t slices = e.slices();
  while (at.after + 1 < slices && e.slice_m(at.after) < z_m) at.before = at.after++;
  const double first_m = e.slice_m(at.before), second_m = e.slice_m(at.after);
  if (second_m < z_m) return {at.after, at.after, 0};
  if (second_m > first_m) at.share = std::clamp((z_m - first_m) / (second_m - first_m), 0.0, 1.0);
  if (at.share < kRounding) return {at.before, at.before, 0};
  return at.share > 1 - kRounding ? Between{at.after, at.after, 0} : at;
}

std::optional<FeltDeviation> felt_log_deviation(const ExplicitModulus& e, const FeltPlace& place) {
  if (e.slices_m.empty()) return std::nullopt;
  const FeltElements felt(e.x_m, e.y_m, place);
  return FeltDeviation{std::sqrt(stated_variance(e, felt, place)), std::sqrt(felt_between_variance(e, felt))};
}

std::vector<SliceBeside> slices_beside(const std::shared_ptr<const ExplicitModulus>& e, double x_m,
                                       double z_m) {
  constexpr std::size_t kMaxEachSide = 16;
  std::vector<SliceBeside> beside;
  const auto inside = [](const std::vector<double>& nodes_m, double at_m) {
    return at_m >= nodes_m.front() && at_m <= nodes_m.back();
  };
  std::size_t first_behind = 0;
  while (first_behind < e->slices() && e->slice_m(first_behind) < z_m) ++first_behind;
  const std::size_t begin = first_behind - std::min(first_behind, kMaxEachSide),
                    end = std::min(e->slices(), first_behind + kMaxEachSide + 1);
  for (std::size_t n = begin; n < end; ++n)
    if (const double offset_m = e->slice_m(n) - z_m; std::abs(offset_m) > kSameSliceM)
      beside.push_back(
          {offset_m, [=](double x, double y) {
             if (!inside(e->x_m, x + x_m) || !inside(e->y_m, y)) return std::nan("");
             const std::size_t nx = e->x_m.size() - 1, plane = nx * (e->y_m.size() - 1);
             return e->youngs_modulus_pa[element(e->x_m, x + x_m) + nx * element(e->y_m, y) + plane * n];
           }});
  return beside;
}

double from_slices_m(const ExplicitModulus& e, double z_m) {
  if (e.slices_m.empty()) return 0;
  const double nearest_m = nearest_slice_m(e, z_m);
  return nearest_m <= spacing_z_m(e) / 2 ? 0 : nearest_m;
}

std::optional<SliceWish> wished_slice(const ExplicitModulus& e, const FeltPlace& place,
                                      const std::optional<double>& tolerance) {
  const double z_m = place.z_m;
  if (from_slices_m(e, z_m) == 0) return std::nullopt;
  const double spacing_m = spacing_z_m(e), last = static_cast<double>(e.z_m.size() - 2),
               before = std::clamp(std::floor((z_m - e.z_m.front()) / spacing_m), 0.0, last),
               middle_m = e.z_m.front() + (before + 0.5) * spacing_m;
  if (nearest_slice_m(e, middle_m) < kSameSliceM) return std::nullopt;  // z is farther by a rounding
  const FeltElements felt(e.x_m, e.y_m, place);
  const double stated = stated_variance(e, felt, place),
               all = std::sqrt(stated + felt_between_variance(e, felt)),
               with_it = std::sqrt(stated + felt_between_variance(e, felt, middle_m)),
               less = ForceBudget::kOf95 * (all - with_it);
  if (less <= tolerance.value_or(usual_tolerance(std::sqrt(stated)).relative)) return std::nullopt;
  return SliceWish{middle_m, ForceBudget::kOf95 * all};
}

namespace {

void check_nodes(const char* field, const std::vector<double>& nodes_m, std::size_t most) {
  if (nodes_m.size() < 2 || nodes_m.size() > most)
    throw std::invalid_argument(fmt::format("{}: {} nodes, must be 2 to {}", field, nodes_m.size(), most));
  for (std::size_t k = 0; k + 1 < nodes_m.size(); ++k)
    if (!(nodes_m[k + 1] > nodes_m[k]))
      throw std::invalid_argument(fmt::format("{}[{}]: nodes must be finite and increase", field, k + 1));
  if (!std::isfinite(nodes_m.back() - nodes_m.front()))
    throw std::invalid_argument(fmt::format("{}: nodes must be finite and increase", field));
}

void check_axis(const char* field, const std::vector<double>& nodes_m, double length_m, std::size_t most) {
  check_nodes(field, nodes_m, most);
  const double slack_m = kNodesSlack * length_m;
  if (!(std::abs(nodes_m.front()) <= slack_m && std::abs(nodes_m.back() - length_m) <= slack_m))
    throw std::invalid_argument(
        fmt::format("{}: runs from {} to {} m, must run from 0 to the scene's size, {} m", field,
                    nodes_m.front(), nodes_m.back(), length_m));
}

// What CreateScene and PublishSlice see to as slices come: what is kept on disk may say otherwise.
void check_slices(const ExplicitModulus& e) {
  const double first_m = e.solid() ? e.z_m.front() : 0, last_m = e.solid() ? e.z_m.back() : -1;
  for (std::size_t n = 0; n < e.slices_m.size(); ++n)
    if (!(e.slices_m[n] >= first_m && e.slices_m[n] <= last_m &&
          (n == 0 || e.slices_m[n - 1] < e.slices_m[n])))
      throw std::invalid_argument(
          fmt::format("slices[{}]: {} m; places must increase, within the solid", n, e.slices_m[n]));
  if (!e.log_deviation.empty() && e.log_deviation.size() != e.youngs_modulus_pa.size())
    throw std::invalid_argument(fmt::format("log_deviation: {} values for {} elements",
                                            e.log_deviation.size(), e.youngs_modulus_pa.size()));
  for (std::size_t n = 0; n < e.log_deviation.size(); ++n)
    if (!(e.log_deviation[n] >= 0 && std::isfinite(e.log_deviation[n])))
      throw std::invalid_argument(fmt::format("log_deviation[{}]: {} cannot be", n, e.log_deviation[n]));
  if (!e.log_modes.empty() && (e.log_deviation.empty() || e.log_modes.size() != e.slices()))
    throw std::invalid_argument(
        fmt::format("log_modes: of {} slices, but there are {}", e.log_modes.size(), e.slices()));
  const auto plane = static_cast<std::ptrdiff_t>(e.log_deviation.size() / e.slices());
  for (std::size_t n = 0; n < e.log_modes.size(); ++n) {
    const auto first = e.log_deviation.begin() + plane * static_cast<std::ptrdiff_t>(n);
    check_log_modes(fmt::format("log_modes[{}]", n), e.log_modes[n], {first, first + plane});
  }
}

}  // namespace

void check_modulus(const ExplicitModulus& e, const SceneGeometry& geometry, const Limits& limits) {
  check_axis("modulus.x_m", e.x_m, geometry.width_m, limits.max_scene_columns);
  check_axis("modulus.y_m", e.y_m, geometry.depth_m, limits.max_scene_elements + 1);
  if (!e.solid() && e.y_m.front() != 0)
    throw std::invalid_argument(fmt::format(
        "modulus.y_m[0]: {} m; depth begins at 0 exactly, the surface of the tissue", e.y_m.front()));
  if (e.solid()) check_nodes("modulus.z_m", e.z_m, limits.max_scene_columns);
  const std::size_t elements = (e.x_m.size() - 1) * (e.y_m.size() - 1) * e.slices();
  const std::size_t most = e.solid() ? limits.max_solid_elements : limits.max_scene_elements;
  if (elements > most)
    throw Error(
        ErrorKind::kExhausted,
        fmt::format("modulus: {} elements, at most {} are allowed; use a coarser grid", elements, most));
  if (e.youngs_modulus_pa.size() != elements)
    throw std::invalid_argument(fmt::format("modulus.youngs_modulus_pa: {} values for {} elements",
                                            e.youngs_modulus_pa.size(), elements));
  check_moduli("modulus.youngs_modulus_pa", e.youngs_modulus_pa);
  check_slices(e);
}

}  // namespace teletact::service
