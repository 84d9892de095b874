#include "service/scene/between_slices.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <utility>

#include "service/base/choices.h"
#include "service/base/squared.h"

namespace teletact::service {
namespace {

using Rows = std::vector<double>;

// In wider gaps, but for rounding, a lump that a finger looks for may lie whole: nothing is told of them.
constexpr double kWidestGapM = choices::kSliceReach + 1e-5;

// Of ln E of what nobody measured, so far from the nearest slice.
double unknown_log_variance(double from_slice_m) {
  return squared(choices::kUnseenDeviation * std::min(1.0, from_slice_m / choices::kSliceReach));
}

// Of ln E at `share` of the way between two others, squared: how far it lies outside them.
double hidden(double before, double at, double after, double share) {
  const double differ = after - before, off = at - before - share * differ;
  return std::max(0.0, squared(off) - share * (1 - share) * squared(differ));
}

class Changes {
 public:
  explicit Changes(const ExplicitModulus& e)
      : e_(e), columns_(e.x_m.size() - 1), rows_(e.y_m.size() - 1), log_(e.youngs_modulus_pa) {
    for (double& value : log_) value = std::log(value);
    for (std::size_t n = 0; n < columns_; ++n)
      x_m_.push_back((e.x_m[n] + e.x_m[n + 1]) / 2), widest_m_ = std::max(widest_m_, width_m(n));
    for (std::size_t n = 0; n + 1 < e.slices(); ++n)
      slices_apart_ += std::min(1.0, gap_m(n) / choices::kSliceReach);
  }

  double gap_m(std::size_t n) const { return e_.slices_m[n + 1] - e_.slices_m[n]; }

  // In the middle of gaps of 2 half_m along the slices' rows; narrower than their elements it falls with the
  // square of the way.
  Rows within(double half_m) {
    constexpr double kAlikeM = 5e-4, kRounding = 1e-6;
    const double seen_m = std::max(half_m, widest_m_);
    if (seen_m > choices::kSliceReach + kRounding) return Rows(rows_, unknown_log_variance(half_m));
    const long key = std::lround(std::ceil(seen_m / kAlikeM - kRounding));
    const auto [at, is_new] = within_.try_emplace(key);
    if (is_new) at->second = rows_of_gap(kAlikeM * static_cast<double>(key));
    Rows out = at->second;
    for (double& variance : out) variance *= squared(half_m / (kAlikeM * static_cast<double>(key)));
    return out;
  }

  // From slice to slice over within them, where three show it; as if one place more did as within them.
  Rows faster_across() {
    constexpr double kLeastShare = 0.25;  // of the way: nearer to one of its neighbours it tells little
    const double length_m = e_.x_m.back() - e_.x_m.front();
    Rows across(rows_, 0.0), along(rows_, 0.0), out(rows_, 1.0);
    double middles = 0;
    for (std::size_t k = 1; k + 1 < e_.slices(); ++k) {
      const double way_m = gap_m(k - 1) + gap_m(k), share = gap_m(k - 1) / way_m,
                   nearer = std::min(share, 1 - share);
      if (nearer < kLeastShare || way_m > 2 * kWidestGapM) continue;
      const Rows as_within = within(way_m / 2);
      for (std::size_t j = 0; j < rows_; ++j) {
        double sum = 0;
        for (std::size_t i = 0; i < columns_; ++i)
          sum += width_m(i) * hidden(log_at(i, j, k - 1), log_at(i, j, k), log_at(i, j, k + 1), share);
        across[j] += sum / length_m / squared(2 * nearer), along[j] += as_within[j];
      }
      ++middles;
    }
    const double places = length_m / std::max(choices::kSliceReach, widest_m_);
    for (std::size_t j = 0; j < rows_; ++j)
      if (middles > 0)
        out[j] = std::max(1.0, (places * across[j] * middles / along[j] + 1) / (places * middles + 1));
    return out;
  }

 private:
  double width_m(std::size_t i) const { return e_.x_m[i + 1] - e_.x_m[i]; }
  double log_at(std::size_t i, std::size_t j, std::size_t slice) const {
    return log_[i + columns_ * (j + rows_ * slice)];
  }

  Rows rows_of_gap(double half_m) const {
    struct Triple {
      std::size_t left, at, right;  // the first of two elements, the second weighs so much
      double of_left, of_right;
    };
    std::vector<Triple> triples;
    const auto before = [&](double x_m) {
      const auto next = std::upper_bound(x_m_.begin() + 1, x_m_.end() - 1, x_m);
      return static_cast<std::size_t>(next - x_m_.begin()) - 1;
    };
    double length_m = 0;
    for (std::size_t n = 0; n < columns_; ++n) {
      const double left_m = x_m_[n] - half_m, right_m = x_m_[n] + half_m;
      if (left_m < x_m_.front() || right_m > x_m_.back()) continue;
      const std::size_t left = before(left_m), right = before(right_m);
      triples.push_back({left, n, right, (left_m - x_m_[left]) / (x_m_[left + 1] - x_m_[left]),
                         (right_m - x_m_[right]) / (x_m_[right + 1] - x_m_[right])});
      length_m += width_m(n);
    }
    Rows out(rows_, unknown_log_variance(half_m));
    if (triples.empty()) return out;
    const double places = slices_apart_ * length_m / std::max(choices::kSliceReach, half_m);
    for (std::size_t j = 0; j < rows_; ++j) {
      double sum = 0;
      for (std::size_t slice = 0; slice < e_.slices(); ++slice)
        for (const Triple& t : triples) {
          const auto beside = [&](std::size_t first, double of_next) {
            return (1 - of_next) * log_at(first, j, slice) + of_next * log_at(first + 1, j, slice);
          };
          sum += width_m(t.at) *
                 hidden(beside(t.left, t.of_left), log_at(t.at, j, slice), beside(t.right, t.of_right), 0.5);
        }
      out[j] = (places * sum / (length_m * static_cast<double>(e_.slices())) + out[j]) / (places + 1);
    }
    return out;
  }

  const ExplicitModulus& e_;
  std::size_t columns_, rows_;
  std::vector<double> log_, x_m_;
  double slices_apart_ = 1;  // as many as are independent
  double widest_m_ = 0;      // element
  std::map<long, Rows> within_;
};

// Tissue between two slices, or beyond an outermost one; of what lies there one more slice leaves `share`.
struct Gap {
  double begin_m, end_m;
  std::size_t after;  // the slice, or their number
  bool told;          // by hidden_log_variance
  double share = 1;
  bool between() const { return std::isfinite(end_m - begin_m); }
};

std::vector<Gap> gaps_of(const ExplicitModulus& e, const std::optional<double>& one_more_m) {
  std::vector<Gap> gaps;
  double begin_m = -HUGE_VAL;
  for (std::size_t n = 0; n <= e.slices_m.size(); ++n) {
    Gap gap{begin_m, n < e.slices_m.size() ? e.slices_m[n] : HUGE_VAL, n, false};
    gap.told = gap.end_m - gap.begin_m <= kWidestGapM && !e.hidden_log_variance.empty();
    begin_m = gap.end_m;
    if (one_more_m && *one_more_m > gap.begin_m && *one_more_m < gap.end_m) {
      const double share = gap.between() ? (*one_more_m - gap.begin_m) / (gap.end_m - gap.begin_m) : 1;
      gaps.push_back({gap.begin_m, *one_more_m, n, gap.told, share});
      gaps.push_back({*one_more_m, gap.end_m, n, gap.told, gap.between() ? 1 - share : 1});
    } else {
      gaps.push_back(gap);
    }
  }
  return gaps;
}

// What a row of elements bears, over z.
class FeltRow {
 public:
  FeltRow(const FeltElements& felt, std::size_t row) : felt_(felt), row_(row) {}
  // Times what grows with the way from a slice towards to_m, to 1 over reach_m.
  double away_from(double slice_m, double to_m, double reach_m) const {
    const double end_m =
                     to_m > slice_m ? std::min(to_m, slice_m + reach_m) : std::max(to_m, slice_m - reach_m),
                 borne = felt_.before(row_, end_m) - felt_.before(row_, slice_m),
                 moment = felt_.moment_before(row_, end_m) - felt_.moment_before(row_, slice_m);
    return (moment + (felt_.z_m() - slice_m) * borne) / reach_m +
           std::abs(felt_.before(row_, to_m) - felt_.before(row_, end_m));
  }
  // Variance of what lies beyond a place that may be anywhere in the gap.
  double beyond_any(const Gap& gap) const {
    constexpr int kPlaces = 8;
    double sum = 0, squares = 0;
    for (int k = 0; k < kPlaces; ++k) {
      const double borne = felt_.before(row_, gap.begin_m + (gap.end_m - gap.begin_m) * (k + 0.5) / kPlaces);
      sum += borne / kPlaces, squares += borne * borne / kPlaces;
    }
    return std::max(0.0, squares - sum * sum);
  }
  // Standard deviation of what neither side of a gap shows, wrong alike all across it.
  double hidden(const ExplicitModulus& e, const Gap& gap) const {
    const double middle_m = (gap.begin_m + gap.end_m) / 2;
    const double reach_m = gap.told ? middle_m - gap.begin_m : choices::kSliceReach;
    double felt = 0;
    if (std::isfinite(gap.begin_m))
      felt += away_from(gap.begin_m, gap.between() ? middle_m : HUGE_VAL, reach_m);
    if (std::isfinite(gap.end_m)) felt += away_from(gap.end_m, gap.between() ? middle_m : -HUGE_VAL, reach_m);
    const std::size_t rows = e.y_m.size() - 1;
    return felt * (gap.told ? gap.share * std::sqrt(e.hidden_log_variance[row_ + rows * (gap.after - 1)])
                            : choices::kUnseenDeviation);
  }

 private:
  const FeltElements& felt_;
  std::size_t row_;
};

}  // namespace

std::vector<double> hidden_log_variance(const ExplicitModulus& e) {
  std::vector<double> out;
  if (e.slices_m.size() < 2) return out;
  Changes changes(e);
  const Rows faster = changes.faster_across();
  for (std::size_t gap = 0; gap + 1 < e.slices(); ++gap) {
    const Rows within = changes.within(changes.gap_m(gap) / 2);
    for (std::size_t j = 0; j < within.size(); ++j) out.push_back(faster[j] * within[j]);
  }
  return out;
}

double felt_between_variance(const ExplicitModulus& e, const FeltElements& felt,
                             std::optional<double> one_more_m) {
  // Gaps that bear less of a row, and less of a change, are not felt: together under 0.04 of one.
  constexpr double kLeast = 0.01, kLeastOfChange = 1e-7;
  // What slices on both sides do not show is as small as the gap; what nobody measured may be wrong alike.
  const double left = left_of_local(felt.radius_m(), choices::kSliceReach);
  const std::size_t columns = e.x_m.size() - 1, rows = e.y_m.size() - 1, plane = columns * rows;
  const std::vector<Gap> gaps = gaps_of(e, one_more_m);
  struct Change {
    std::size_t after;  // the slice
    double variance;    // over the squared change of ln E
  };
  std::vector<double> hidden(rows, 0.0);
  std::vector<std::vector<Change>> changes(rows);
  for (std::size_t j = 0; j < rows; ++j) {
    const FeltRow row(felt, j);
    double before = 0;
    for (const Gap& gap : gaps) {
      const double up_to = felt.before(j, gap.end_m), borne = up_to - std::exchange(before, up_to);
      if (borne < kLeast) continue;
      hidden[j] += (gap.told ? left : 1) * squared(row.hidden(e, gap));
      if (gap.after > 0 && gap.after < e.slices_m.size())
        changes[j].push_back({gap.after, (gap.told ? left : 1) * squared(gap.share) * row.beyond_any(gap)});
    }
  }
  double variance = 0;
  felt.each([&](std::size_t element, double share) {
    const std::size_t j = element / columns;
    variance += share * hidden[j];
    for (const Change& change : changes[j]) {
      if (share * change.variance < kLeastOfChange) continue;
      const double* after = e.youngs_modulus_pa.data() + element + plane * change.after;
      variance += share * change.variance * squared(std::log(*after / *(after - plane)));
    }
  });
  return variance;
}

}  // namespace teletact::service
