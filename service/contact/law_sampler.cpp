#include "service/contact/law_sampler.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <iterator>
#include <span>
#include <utility>

namespace teletact::service {

LawSampler::LawSampler(std::shared_ptr<TouchedLayer> touched, const Layer& layer, const Fingertip& tip,
                       double begin_m, double end_m, const LawTolerance& tolerance)
    : touched_(std::move(touched)), layer_(layer), tip_(tip), tolerance_(tolerance) {
  wanted_.push_back(begin_m);
  const double pitch_m = choices::kLawPitch;
  for (double k = std::floor(begin_m / pitch_m) + 1; k * pitch_m < end_m; ++k)
    if (k * pitch_m - wanted_.back() > choices::kLawLeastCell && end_m - k * pitch_m > choices::kLawLeastCell)
      wanted_.push_back(k * pitch_m);
  wanted_.push_back(end_m);
  if (wanted_.size() > choices::kMostLawColumns) wanted_.clear();
}

std::optional<LawSampler::Contact> LawSampler::touch(double x_m, double log_depth) try {
  ++report_.solves;
  const double d = std::exp(log_depth);
  const TouchPose at = at_indentation(layer_, {{x_m, 0, 0}}, d);
  touched_->prepare(tip_, at, 0, Clock::now() + choices::kLongestSolve);
  const ContactAnswer answer = touched_->touch(tip_, at);
  const double u = answer.energy_j;
  if (!(u > 0) || !answer.solve.converged) return std::nullopt;
  const double by_x = -answer.force_n[0], by_d = -answer.force_n[1], by_xd = -answer.tangent_n_m[1];
  const double w_x = by_x / u, w_s = d * by_d / u;
  const Contact contact{
      {float(std::log(u)), float(w_x), float(w_s), float(d * by_xd / u - w_x * w_s)}, by_x, by_d};
  return w_s > 0 ? std::optional(contact) : std::nullopt;
} catch (const std::exception&) {  // the model's limits
  return std::nullopt;
}

double LawSampler::error(const Contact& contact, double by_x_n, double by_d_n) const {
  const double off_n = std::hypot(by_x_n - contact.by_x_n, by_d_n - contact.by_d_n);
  return off_n / (tolerance_.share * std::hypot(contact.by_x_n, contact.by_d_n) + tolerance_.floor_n);
}

// The samples that every column has, and what it takes between them.
LawColumn LawSampler::column_at(double x_m) {
  LawColumn column;
  column.x_m = x_m;
  for (const double depth_m : choices::kLawDepths) {
    const auto contact = touch(x_m, std::log(depth_m));
    if (!contact) break;
    column.log_depth[column.rows] = float(std::log(depth_m));
    column.samples[column.rows++] = contact->sample;
  }
  return column;
}

// Halves intervals of depth until the force between is right.
void LawSampler::refine_rows(LawColumn& column) {
  for (std::size_t i = 0; i + 1 < column.rows;) {
    const float middle = (column.log_depth[i] + column.log_depth[i + 1]) / 2;
    const auto contact = touch(column.x_m, middle);
    if (!contact) return;
    // At its own place nothing of the column beside it is felt.
    std::array<LawColumn, 2> alone{column, column};
    alone[1].x_m += choices::kLawPitch;
    const LawValue value = evaluate(alone, column.x_m, std::exp(double(middle)));
    const double off = error(*contact, value.by_x_n, value.by_d_n);
    if (off <= choices::kLawKept || column.rows == LawColumn::kMostRows) {
      report_.worst_error = std::max(report_.worst_error, off);
      ++i;
      continue;
    }
    const auto row = static_cast<std::ptrdiff_t>(i) + 1;
    std::shift_right(column.log_depth.begin() + row, column.log_depth.begin() + column.rows + 1, 1);
    std::shift_right(column.samples.begin() + row, column.samples.begin() + column.rows + 1, 1);
    column.log_depth[i + 1] = middle;
    column.samples[i + 1] = contact->sample;
    ++column.rows;
  }
}

void LawSampler::insert(const LawColumn& column) {
  if (column.rows == 0) return;
  const auto at = std::upper_bound(columns_.begin(), columns_.end(), column.x_m,
                                   [](double x, const LawColumn& other) { return x < other.x_m; });
  columns_.insert(at, column);
  report_.samples += column.rows;
}

// A column in the middle: kept, and both halves checked, where the force of the cell is off at its samples.
void LawSampler::check(const Cell& cell) {
  const double middle_m = (cell.begin_m + cell.end_m) / 2;
  LawColumn column = column_at(middle_m);
  double off = 0;
  for (std::size_t i = 0; i < column.rows; ++i) {
    const double d = std::exp(double(column.log_depth[i]));
    const LawValue value = evaluate(columns_, middle_m, d);
    const double u = std::exp(double(column.samples[i].log_energy));
    const Contact contact{{}, u * column.samples[i].by_x_1_m, u * column.samples[i].by_log_depth / d};
    off = std::max(off, error(contact, value.by_x_n, value.by_d_n));
  }
  if (off <= choices::kLawKept || cell.halvings == 0 || columns_.size() >= choices::kMostLawColumns) {
    report_.worst_error = std::max(report_.worst_error, off);
    return;
  }
  refine_rows(column);
  insert(column);
  cells_.push_back({cell.begin_m, middle_m, cell.halvings - 1});
  cells_.push_back({middle_m, cell.end_m, cell.halvings - 1});
}

bool LawSampler::advance(double x_m, Clock::time_point until) {
  const auto distance = [x_m](const Cell& c) { return std::max({0.0, c.begin_m - x_m, x_m - c.end_m}); };
  while (Clock::now() < until) {
    if (!wanted_.empty()) {
      const auto next = std::min_element(wanted_.begin(), wanted_.end(), [x_m](double a, double b) {
        return std::abs(a - x_m) < std::abs(b - x_m);
      });
      LawColumn column = column_at(*next);
      wanted_.erase(next);
      refine_rows(column);
      insert(column);
      if (wanted_.empty())
        for (std::size_t i = 0; i + 1 < columns_.size(); ++i)
          cells_.push_back({columns_[i].x_m, columns_[i + 1].x_m, choices::kLawHalvings});
      continue;
    }
    if (cells_.empty()) return true;
    const auto next = std::min_element(cells_.begin(), cells_.end(), [&](const Cell& a, const Cell& b) {
      return distance(a) < distance(b);
    });
    const Cell cell = *next;
    cells_.erase(next);
    check(cell);
  }
  return wanted_.empty() && cells_.empty();
}

}  // namespace teletact::service
