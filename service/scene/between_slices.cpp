#include "service/scene/between_slices.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>

#include "service/base/choices.h"
#include "service/base/squared.h"

namespace teletact::service {
namespace {

using Rows = std::vector<double>;

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

}  // namespace

double unknown_log_variance(double from_slice_m) {
  return squared(choices::kUnseenDeviation * std::min(1.0, from_slice_m / choices::kSliceReach));
}

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

}  // namespace teletact::service
