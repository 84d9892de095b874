#include "service/contact/area_sampler.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <numeric>
#include <span>
#include <utility>

#include "service/base/choices.h"
#include "service/device/device.h"

namespace teletact::service {
namespace {

// Poses that are tried lie at this share of a cell, from one end or the other, as in law_sampler.cpp.
constexpr double kAreaTriedAt = 0.3;
constexpr std::size_t kTried = 2;  // in each cell

// From begin to just before end, on one lattice of the scene.
std::vector<double> lattice(double begin_m, double end_m) {
  constexpr double kPitchM = choices::kLawPitch, kMinM = choices::kLawLeastCell;
  std::vector<double> places{begin_m};
  for (double k = std::floor(begin_m / kPitchM) + 1; k * kPitchM < end_m - kMinM; ++k)
    if (k * kPitchM - places.back() > kMinM) places.push_back(k * kPitchM);
  places.push_back(std::nextafter(end_m, begin_m));
  return places;
}

std::span<const double> depths_of(const Fingertip& tip) {
  if (tip.friction == Friction::kStuck) return choices::kStuckLawDepths;
  return choices::kLawDepths;
}

// d3W/dx dz ds of each row: the slope there of the parabola through d2W/dx dz of it and the rows beside it.
void set_slopes(LawColumn& column) {
  const auto slope = [&](std::size_t i) {
    return (column.samples[i + 1].by_xz_1_m2 - column.samples[i].by_xz_1_m2) /
           (column.log_depth[i + 1] - column.log_depth[i]);
  };
  for (std::size_t i = 0; i < column.rows && column.rows > 1; ++i) {
    const std::size_t last = column.rows - 1u;
    if (i == 0 || i == last) {
      column.samples[i].by_xzs_1_m2 = slope(i == 0 ? 0 : last - 1);
      continue;
    }
    const float before = column.log_depth[i] - column.log_depth[i - 1],
                after = column.log_depth[i + 1] - column.log_depth[i];
    column.samples[i].by_xzs_1_m2 = (after * slope(i - 1) + before * slope(i)) / (before + after);
  }
}

double size_n(const Vector3& force) {
  return std::hypot(force[0], force[1], force[2]);
}

// In tolerances.
double off_by(const LawValue& value, const Vector3& by_n) {
  return size_n({value.by_x_n - by_n[0], value.by_d_n - by_n[1], value.by_z_n - by_n[2]}) /
         (choices::kLawShare * size_n(by_n) + choices::kLawFloor);
}

}  // namespace

AreaSampler::AreaSampler(std::shared_ptr<TouchedLayer> touched, const Layer& layer, const Fingertip& tip,
                         const Region& region, const Vector3& near_m)
    : touched_(std::move(touched)), layer_(layer), tip_(tip) {
  const auto columns_of = [](double begin_m, double end_m) {
    return (end_m - begin_m) / choices::kLawPitch + 2;
  };
  if (columns_of(region.begin_x_m, region.end_x_m) * columns_of(region.z->begin_m, region.z->end_m) >
      double(choices::kMaxLawColumns))
    return;
  x_m_ = lattice(region.begin_x_m, region.end_x_m);
  z_m_ = lattice(region.z->begin_m, region.z->end_m);
  for (std::size_t lane = 0; lane < z_m_.size(); ++lane)
    for (const double x_m : x_m_) {
      LawColumn& column = places_.emplace_back().sampled;
      column.x_m = x_m;
      column.of_area = true;
      column.z_m = z_m_[lane];
      column.lane_before_m = z_m_[lane - std::min<std::size_t>(lane, 1)];
    }
  order_.resize(places_.size());
  std::iota(order_.begin(), order_.end(), 0);
  std::ranges::stable_sort(order_, {}, [&](std::size_t i) {
    const LawColumn& column = places_[i].sampled;
    return std::hypot(column.x_m - near_m[0], column.z_m - near_m[2]);
  });
  begin_turn(false);
}

void AreaSampler::begin_turn(bool correcting) {
  correcting_ = correcting;
  next_ = 0;
  for (std::size_t i = 0; i < places_.size(); ++i) {
    places_[i].is_sampled = false;
    places_[i].off = places_[i].known_to = 0;
    places_[i].cells_left = cells_around(i).size();
  }
}

std::vector<AreaSampler::Corners> AreaSampler::cells_around(std::size_t place) const {
  const std::size_t width = x_m_.size(), column = place % width, lane = place / width;
  std::vector<Corners> cells;
  for (const std::size_t k : {lane - 1, lane})  // of the first one: none, wraps to the largest
    for (const std::size_t i : {column - 1, column})
      if (k < z_m_.size() - 1 && i < width - 1) {
        const std::size_t first = i + width * k;
        cells.push_back({first, first + 1, first + width, first + width + 1});
      }
  return cells;
}

LawSample AreaSampler::Contact::at(double d) const {
  const double w_x = by_n[0] / energy_j, w_s = d * by_n[1] / energy_j, w_z = by_n[2] / energy_j;
  return {float(std::log(energy_j)),
          float(w_x),
          float(w_s),
          float(d * curved[0] / energy_j - w_x * w_s),
          float(w_z),
          float(d * curved[1] / energy_j - w_z * w_s),
          float(curved[2] / energy_j - w_x * w_z),
          0};
}

// None: the model cannot say. A tip that touches no node yet has no energy. A device that fails, and memory
// that there is none of, end the sampling.
std::optional<AreaSampler::Contact> AreaSampler::touch(double x_m, double z_m, double d) try {
  ++solves_;
  const TouchPose at = at_indentation(layer_, {{x_m, 0, z_m}}, d);
  if (correcting_)
    if (const auto job = touched_->wanted(tip_, at, 0)) job->work(Clock::now() + choices::kLongestSolve);
  const ContactAnswer answer = touched_->answer(tip_, at);
  const auto& f = answer.force_n;
  const auto& t = answer.tangent_n_m;
  return Contact{
      answer.energy_j,
      {-f[0], -f[1], -f[2]},
      {-t[1], -t[5], -t[2]},
      answer.solve.relative_error + ForceBudget::kOf95 * answer.budget.relative(ErrorTerm::kModel)};
} catch (const DeviceError&) {
  throw;
} catch (const MemoryRefused&) {
  throw;
} catch (const std::exception&) {  // the model's limits
  return std::nullopt;
}

// A contact that spans few nodes ripples with them, and its slopes are the ripple's, which a cubic carries
// far (T7.2b): the mean of two poses half a spacing apart along x and z does not. At an end of the tissue:
// there alone.
std::optional<AreaSampler::Contact> AreaSampler::averaged(double x_m, double z_m, double d) {
  const auto [along_x_m, along_z_m] = touched_->spacing_m(x_m);
  const double aside_x_m = along_x_m / 4, aside_z_m = along_z_m / 4;
  const auto inside = [](double at, double aside, const std::vector<double>& ends) {
    return at - aside >= ends.front() && at + aside <= ends.back();
  };
  if (!(d < std::max(along_x_m, along_z_m)) || !inside(x_m, aside_x_m, x_m_) || !inside(z_m, aside_z_m, z_m_))
    return touch(x_m, z_m, d);
  auto mean = touch(x_m - aside_x_m, z_m - aside_z_m, d);
  const auto other = touch(x_m + aside_x_m, z_m + aside_z_m, d);
  if (!mean || !other) return std::nullopt;
  const auto add = [](Vector3& to, const Vector3& from) {
    for (std::size_t c = 0; c < 3; ++c) to[c] = (to[c] + from[c]) / 2;
  };
  mean->energy_j = (mean->energy_j + other->energy_j) / 2;
  add(mean->by_n, other->by_n), add(mean->curved, other->curved);
  mean->known_to = std::max(mean->known_to, other->known_to);
  return mean;
}

void AreaSampler::begin(Place& place) {
  place.sampled.rows = 0;
  place.sampled.corrected = correcting_;
  rows_left_ = depths_of(tip_).size();
  rows_.assign(rows_left_, std::nullopt);
}

// One row, from below: what corrects a deep contact is most of what corrects those above it. With the last of
// them the column is known.
void AreaSampler::sample(Place& place) {
  LawColumn& column = place.sampled;
  const auto depths = depths_of(tip_);
  --rows_left_;
  rows_[rows_left_] = averaged(column.x_m, column.z_m, depths[rows_left_]);
  if (rows_left_ > 0) return;
  for (std::size_t i = 0; i < depths.size(); ++i) {
    const bool touches = rows_[i] && rows_[i]->energy_j > 0 && rows_[i]->by_n[1] > 0;
    if (!touches && column.rows == 0 && rows_[i]) continue;  // the tip is above its nodes still
    if (!touches) break;
    column.log_depth[column.rows] = float(std::log(depths[i]));
    column.samples[column.rows++] = rows_[i]->at(depths[i]);
    place.known_to = std::max(place.known_to, rows_[i]->known_to);
  }
  set_slopes(column);
  place.is_sampled = true;
}

// Poses amid the cell. What cannot be tried is not claimed.
void AreaSampler::try_cell(const Corners& corners) {
  std::array<LawColumn, 4> cell;
  std::size_t rows = LawColumn::kMaxRows;
  for (std::size_t i = 0; i < 4; ++i) {
    cell[i] = places_[corners[i]].sampled;
    rows = std::min<std::size_t>(rows, cell[i].rows);
  }
  cell[2].lane_before_m = cell[3].lane_before_m = cell[0].z_m;
  double off = rows < 2 ? 1 / choices::kLawShare : 0, known_to = 0;
  for (std::size_t k = 0; k < kTried && rows > 1; ++k) {
    const double x_m = std::lerp(cell[0].x_m, cell[1].x_m, k % 2 ? kAreaTriedAt : 1 - kAreaTriedAt),
                 z_m = std::lerp(cell[0].z_m, cell[2].z_m, kAreaTriedAt),
                 row = k % 2 ? kAreaTriedAt : 1 - kAreaTriedAt;
    const std::size_t above = rows - 2 - std::min(k, rows - 2);
    const double d =
        std::exp(std::lerp(double(cell[0].log_depth[above]), double(cell[0].log_depth[above + 1]), row));
    const auto contact = touch(x_m, z_m, d);
    const double here = contact ? off_by(evaluate(cell, x_m, d, z_m), contact->by_n) : HUGE_VAL;
    if (!std::isfinite(here)) {
      off = 1 / choices::kLawShare;
      break;
    }
    off = std::max(off, here);
    known_to = std::max(known_to, contact->known_to);
  }
  for (const std::size_t i : corners) {
    places_[i].off = std::max(places_[i].off, off);
    places_[i].known_to = std::max(places_[i].known_to, known_to);
    if (--places_[i].cells_left == 0) show(places_[i]);
  }
}

// A guess stays where nothing better was found.
void AreaSampler::show(Place& place) {
  if (place.sampled.rows > 0 && !usable(place.sampled)) return;  // no tissue's: nobody would take it
  const bool tried = place.sampled.rows >= place.shown.rows && place.off < 1 / choices::kLawShare;
  if (correcting_ && !tried) return;
  place.shown = place.sampled;
  const double stated =
      std::clamp(choices::kLawBetween * place.off, choices::kLawLeastStated, 1 / choices::kLawShare);
  place.shown.error_share = float(std::min(1.0, choices::kLawShare * stated + place.known_to));
  place.shown.error_n = float(choices::kLawFloor * stated);
}

bool AreaSampler::advance(Clock::time_point until) {
  do {
    if (!untried_.empty()) {
      try_cell(untried_.back());
      untried_.pop_back();
      continue;
    }
    if (rows_left_ == 0) {
      if (next_ == order_.size()) {
        if (correcting_ || order_.empty()) return true;
        begin_turn(true);
      }
      begin(places_[order_[next_++]]);
    }
    const std::size_t place = order_[next_ - 1];
    sample(places_[place]);
    if (rows_left_ > 0) continue;
    for (const Corners& corners : cells_around(place))
      if (std::ranges::all_of(corners, [&](std::size_t i) { return places_[i].is_sampled; }))
        untried_.push_back(corners);
  } while (Clock::now() < until);
  return false;
}

std::vector<LawColumn> AreaSampler::columns() const {
  std::vector<LawColumn> known;
  for (std::size_t i = 0; i < places_.size(); ++i) {
    if (places_[i].shown.rows == 0) continue;
    known.push_back(places_[i].shown);
    known.back().joined = i % x_m_.size() > 0 && places_[i - 1].shown.rows > 0;
  }
  return known;
}

}  // namespace teletact::service
