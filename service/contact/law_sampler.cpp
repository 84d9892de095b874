#include "service/contact/law_sampler.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <iterator>
#include <utility>

namespace teletact::service {
namespace {

// Poses that are tried lie at this share of an interval, from one end or the other: about where the slopes of
// a cubic are most off. In the middle they are right whatever its value is off by.
constexpr double kTriedAt = 0.3;
// In each interval of depth; many where ripples are not followed, and where the tip is stuck.
constexpr std::size_t kFew = 2, kMany = 4;

double depth_m(const LawColumn& column, std::size_t row) {
  return std::exp(double(column.log_depth[row]));
}

// The depth in the interval below this row that is tried.
double tried_depth_m(const LawColumn& column, std::size_t row, double share) {
  const double begin = column.log_depth[row], end = column.log_depth[row + 1];
  return std::exp(begin + share * (end - begin));
}

void end_at(LawColumn& column, double deepest_m) {
  while (column.rows > 1 && depth_m(column, column.rows - 1u) > deepest_m * 1.000001) --column.rows;
}

}  // namespace

LawSampler::LawSampler(std::shared_ptr<TouchedLayer> touched, const Layer& layer, const Fingertip& tip,
                       double begin_m, double end_m, double near_m)
    : touched_(std::move(touched)),
      layer_(layer),
      tip_(tip),
      near_m_(near_m),
      kept_(tip.friction == Friction::kStuck ? std::span<const double>(choices::kStuckLawKept)
                                             : choices::kLawKept) {
  const bool stuck = tip.friction == Friction::kStuck;
  for (const double depth_m : stuck ? choices::kStuckLawDepths : choices::kLawDepths)
    first_rows_.log_depth[first_rows_.rows++] = float(std::log(depth_m));
  const double pitch_m = choices::kLawPitch;
  if (end_m - begin_m > pitch_m * double(choices::kMaxLawColumns)) return;
  const auto add = [this](double x_m) { places_.emplace_back().column.x_m = x_m; };
  add(begin_m);
  for (double k = std::floor(begin_m / pitch_m) + 1; k * pitch_m < end_m; ++k)
    if (k * pitch_m - places_.back().column.x_m > choices::kLawLeastCell &&
        end_m - k * pitch_m > choices::kLawLeastCell)
      add(k * pitch_m);
  add(end_m);
}

// None: the model cannot say. A tip that touches no node yet has no force. Of two poses to both sides: the
// mean of their energies, and its derivatives.
std::optional<LawSampler::Contact> LawSampler::touch(double x_m, double d, double to_each_side_m) try {
  double u = 0, by_x = 0, by_d = 0, by_xd = 0;
  const double share = to_each_side_m > 0 ? 0.5 : 1;
  for (const double side : {-1.0, 1.0}) {
    if (side > 0 && share == 1) break;
    ++solves_;
    const TouchPose at = at_indentation(layer_, {{x_m + side * to_each_side_m, 0, 0}}, d);
    const ContactAnswer answer = touched_->answer(tip_, at);
    if (!answer.solve.converged) return std::nullopt;
    u += share * answer.energy_j;
    by_x -= share * answer.force_n[0], by_d -= share * answer.force_n[1];
    by_xd -= share * answer.tangent_n_m[1];
  }
  if (!(u > 0)) return Contact{};
  const double w_x = by_x / u, w_s = d * by_d / u;
  return Contact{{float(std::log(u)), float(w_x), float(w_s), float(d * by_xd / u - w_x * w_s)}, by_x, by_d};
} catch (const std::exception&) {  // the model's limits
  return std::nullopt;
}

// For its samples.
std::optional<LawSampler::Contact> LawSampler::touch(const Place& place, double d) {
  const double x_m = place.column.x_m;
  return touch(x_m, d, place.averaged ? touched_->spacing_m(x_m)[0] / 4 : 0);
}

double LawSampler::kept(const Place& place) const {
  return kept_[std::min(place.halved, kept_.size() - 1)];
}

double LawSampler::off(const LawValue& value, const Contact& contact) const {
  return std::hypot(value.by_x_n - contact.by_x_n, value.by_d_n - contact.by_d_n) /
         (choices::kLawShare * std::hypot(contact.by_x_n, contact.by_d_n) + choices::kLawFloor);
}

// Where a cell beside it is settled: it is shown, and not altered any more.
bool LawSampler::known(std::size_t place) const {
  return places_[place].settled || (place > 0 && places_[place - 1].settled);
}

// At the depths of another, down to where the model ends.
void LawSampler::sample(Place& place, const LawColumn& like) {
  place.sampled = true;
  LawColumn& column = place.column;
  for (std::size_t i = 0; i < like.rows; ++i) {
    const auto contact = touch(place, depth_m(like, i));
    if (!contact || !(contact->sample.by_log_depth > 0)) return;
    column.log_depth[i] = like.log_depth[i];
    column.samples[i] = contact->sample;
    ++column.rows;
  }
}

// Halves intervals of depth until the force between is right, at the column's own place, where nothing of the
// one beside it is felt.
void LawSampler::refine_rows(Place& place) {
  place.refined = true;
  LawColumn& column = place.column;
  for (std::size_t i = 0; i + 1 < column.rows && column.rows < LawColumn::kMaxRows;) {
    std::array<LawColumn, 2> alone{column, column};
    alone[1].x_m += choices::kLawPitch;
    const double d = tried_depth_m(column, i, kTriedAt);
    const auto contact = touch(place, d);
    if (!contact) return;  // the cell's poses will say so, too
    if (off(evaluate(alone, column.x_m, d), *contact) <= kept(place)) {
      ++i;
      continue;
    }
    const float middle = (column.log_depth[i] + column.log_depth[i + 1]) / 2;
    const auto between = touch(place, std::exp(double(middle)));
    if (!between || !(between->sample.by_log_depth > 0)) return;
    const auto row = static_cast<std::ptrdiff_t>(i) + 1;
    std::shift_right(column.log_depth.begin() + row, column.log_depth.begin() + column.rows + 1, 1);
    std::shift_right(column.samples.begin() + row, column.samples.begin() + column.rows + 1, 1);
    column.log_depth[i + 1] = middle;
    column.samples[i + 1] = between->sample;
    ++column.rows;
  }
}

// Two poses above the first row and two between any two rows. Where one cannot be tried the columns end
// above, as far as they are not shown yet.
std::vector<LawSampler::Tried> LawSampler::try_cell(std::size_t cell, std::size_t begin, std::size_t end) {
  LawColumn &left = places_[cell].column, &right = places_[cell + 1].column;
  const LawColumn finer = left.rows > right.rows ? left : right;
  std::vector<Tried> tried;
  for (std::size_t i = 0; i < finer.rows; ++i)
    for (std::size_t k = begin; k < end; ++k) {
      const double share = k % 2 ? kTriedAt : 1 - kTriedAt;
      const double below = (i + k + k / 2) % 2 ? kTriedAt : 1 - kTriedAt;
      const double x_m = left.x_m + share * (right.x_m - left.x_m);
      const double d_m = i == 0 ? depth_m(finer, 0) * std::pow(choices::kLawLightest, below + 0.2)
                                : tried_depth_m(finer, i - 1, below);
      if (d_m > std::min(depth_m(left, left.rows - 1u), depth_m(right, right.rows - 1u))) return tried;
      const auto contact = touch(x_m, d_m);
      if (!contact) {
        if (i == 0) return {};
        if (!known(cell)) end_at(left, depth_m(finer, i - 1));
        if (!known(cell + 1)) end_at(right, depth_m(finer, i - 1));
        return tried;
      }
      tried.push_back({x_m, d_m, *contact});
    }
  return tried;
}

double LawSampler::worst(std::size_t cell, const std::vector<Tried>& tried) const {
  const std::array<LawColumn, 2> pair{places_[cell].column, places_[cell + 1].column};
  double most = 0;
  for (const Tried& t : tried) most = std::max(most, off(evaluate(pair, t.x_m, t.d_m), t.contact));
  return most;
}

// Of the mesh's ripple a column has one phase, and its slopes are the ripple's, which a cubic carries far.
// Kept, and tried at more poses, where all of them are right then; where they are not, finer cells do better.
void LawSampler::average(std::size_t cell, std::vector<Tried>& tried) {
  const std::array before{places_[cell], places_[cell + 1]};
  bool altered = false;
  for (const std::size_t i : {cell, cell + 1}) {
    Place& place = places_[i];
    if (known(i) || !(touched_->spacing_m(place.column.x_m)[0] > 0)) continue;
    const LawColumn like = std::exchange(place.column, LawColumn{.x_m = place.column.x_m});
    place.averaged = true;
    sample(place, like);
    if (place.column.rows < like.rows) place = before[i - cell];
    altered = altered || place.averaged;
  }
  if (altered && worst(cell, tried) <= 1) {
    std::vector<Tried> more = try_cell(cell, kFew, kMany);
    if (!more.empty() && worst(cell, more) <= 1) {
      std::move(more.begin(), more.end(), std::back_inserter(tried));
      return;
    }
  }
  std::copy(before.begin(), before.end(), places_.begin() + std::ptrdiff_t(cell));
}

// Where the poses that are tried are off, both columns have more rows, and if that is not it, the cell is
// halved. What it is off by in the end is stated by those of its columns that are not shown yet.
void LawSampler::settle(std::size_t cell) {
  for (const std::size_t i : {cell, cell + 1})
    if (!places_[i].sampled) sample(places_[i], first_rows_);
  const auto both_have_rows = [&] {
    return places_[cell].column.rows > 0 && places_[cell + 1].column.rows > 0;
  };
  const bool averaged = places_[cell].averaged || places_[cell + 1].averaged;
  const bool stuck = tip_.friction == Friction::kStuck;
  double off_here = 1 / choices::kLawShare;  // where nothing can be tried
  if (both_have_rows()) {
    std::vector<Tried> tried = try_cell(cell, 0, averaged || stuck ? kMany : kFew);
    const auto fails = [&] { return !tried.empty() && worst(cell, tried) > kept(places_[cell]); };
    if (!averaged && !stuck && places_[cell].halved == 0 && fails()) average(cell, tried);
    if (!tried.empty()) off_here = worst(cell, tried);
    if (fails()) {
      for (const std::size_t i : {cell, cell + 1})
        if (!places_[i].refined && !known(i)) refine_rows(places_[i]);
      off_here = worst(cell, tried);
    }
  }
  Place &left = places_[cell], &right = places_[cell + 1];
  if (off_here > kept(left) && left.halved < kept_.size() && places_.size() < choices::kMaxLawColumns) {
    ++left.halved;
    Place middle;
    middle.halved = left.halved;
    middle.averaged = left.averaged || right.averaged;
    middle.column.x_m = (left.column.x_m + right.column.x_m) / 2;
    sample(middle, left.column.rows > right.column.rows ? left.column : right.column);
    places_.insert(places_.begin() + std::ptrdiff_t(cell) + 1, middle);
    return;
  }
  for (const std::size_t i : {cell, cell + 1})
    if (!known(i)) places_[i].off = off_here;
  left.settled = true;
}

bool LawSampler::advance(Clock::time_point until) {
  do {
    double min_m = HUGE_VAL;
    std::size_t next = places_.size();
    for (std::size_t i = 0; i + 1 < places_.size(); ++i) {
      const double off_m =
          std::max({0.0, places_[i].column.x_m - near_m_, near_m_ - places_[i + 1].column.x_m});
      if (!places_[i].settled && off_m < min_m) min_m = off_m, next = i;
    }
    if (next == places_.size()) return true;
    settle(next);
  } while (Clock::now() < until);
  return false;
}

std::vector<LawColumn> LawSampler::columns() const {
  std::vector<LawColumn> shown;
  for (std::size_t i = 0; i < places_.size(); ++i) {
    if (!known(i) || places_[i].column.rows == 0) continue;
    const double stated =
        std::clamp(choices::kLawBetween * places_[i].off, choices::kLawLeastStated, 1 / choices::kLawShare);
    shown.push_back(places_[i].column);
    shown.back().error_share = float(choices::kLawShare * stated);
    shown.back().error_n = float(choices::kLawFloor * stated);
  }
  return shown;
}

}  // namespace teletact::service
