#include "service/scene/between_slices.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>

#include "service/base/choices.h"

namespace teletact::service {
namespace {

using Rows = std::vector<double>;

double squared(double value) {
  return value * value;
}

// What nothing is known of, so far from what is.
double unknown(double half_m) {
  return squared(choices::kUnseenDeviation * std::min(1.0, half_m / choices::kSliceReach));
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
    for (std::size_t n = 0; n < columns_; ++n) x_m_.push_back((e.x_m[n] + e.x_m[n + 1]) / 2);
    for (std::size_t n = 0; n + 1 < e.slices(); ++n)
      slices_apart_ += std::min(1.0, gap_m(n) / choices::kSliceReach);
  }

  double gap_m(std::size_t n) const { return e_.slices_m[n + 1] - e_.slices_m[n]; }

  // In the middle of gaps of 2 half_m along the slices' rows.
  const Rows& within(double half_m) {
    constexpr double kAlikeM = 5e-4;
    const long key = std::max(1L, std::lround(half_m / kAlikeM));
    const auto [at, is_new] = within_.try_emplace(key);
    if (is_new) at->second = rows_of_gap(kAlikeM * static_cast<double>(key));
    return at->second;
  }

  // From slice to slice over within them, where three show it.
  Rows faster_across() {
    constexpr double kLeastShare = 0.25;  // of the way: nearer to one of its neighbours it tells little
    const double places = (e_.x_m.back() - e_.x_m.front()) / choices::kSliceReach;
    Rows across(rows_, 0.0), along(rows_, 0.0), out(rows_, 1.0);
    double middles = 0, unknowns = 0;
    for (std::size_t k = 1; k + 1 < e_.slices(); ++k) {
      const double way_m = gap_m(k - 1) + gap_m(k), share = gap_m(k - 1) / way_m,
                   nearer = std::min(share, 1 - share);
      if (nearer < kLeastShare) continue;
      const Rows& as_within = within(way_m / 2);
      for (std::size_t j = 0; j < rows_; ++j) {
        double sum = 0;
        for (std::size_t i = 0; i < columns_; ++i)
          sum += hidden(log_at(i, j, k - 1), log_at(i, j, k), log_at(i, j, k + 1), share);
        across[j] += sum / static_cast<double>(columns_) / squared(2 * nearer), along[j] += as_within[j];
      }
      ++middles, unknowns += unknown(way_m / 2);
    }
    for (std::size_t j = 0; j < rows_; ++j)
      if (middles > 0)
        out[j] = std::max(
            1.0, (places * across[j] + unknowns / middles) / (places * middles + 1) * middles / along[j]);
    return out;
  }

 private:
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
    for (std::size_t n = 0; n < columns_; ++n) {
      const double left_m = x_m_[n] - half_m, right_m = x_m_[n] + half_m;
      if (left_m < x_m_.front() || right_m > x_m_.back()) continue;
      const std::size_t left = before(left_m), right = before(right_m);
      triples.push_back({left, n, right, (left_m - x_m_[left]) / (x_m_[left + 1] - x_m_[left]),
                         (right_m - x_m_[right]) / (x_m_[right + 1] - x_m_[right])});
    }
    Rows out(rows_, unknown(half_m));
    if (triples.empty()) return out;
    const double count = static_cast<double>(triples.size() * e_.slices()),
                 places = slices_apart_ * (x_m_.back() - x_m_.front() - 2 * half_m) / choices::kSliceReach;
    for (std::size_t j = 0; j < rows_; ++j) {
      double sum = 0;
      for (std::size_t slice = 0; slice < e_.slices(); ++slice)
        for (const Triple& t : triples) {
          const auto beside = [&](std::size_t first, double of_next) {
            return (1 - of_next) * log_at(first, j, slice) + of_next * log_at(first + 1, j, slice);
          };
          sum += hidden(beside(t.left, t.of_left), log_at(t.at, j, slice), beside(t.right, t.of_right), 0.5);
        }
      out[j] = (places * sum / count + out[j]) / (places + 1);
    }
    return out;
  }

  const ExplicitModulus& e_;
  std::size_t columns_, rows_;
  std::vector<double> log_, x_m_;
  double slices_apart_ = 1;  // as many as are independent
  std::map<long, Rows> within_;
};

}  // namespace

std::vector<double> hidden_log_variance(const ExplicitModulus& e) {
  std::vector<double> out;
  if (e.slices_m.size() < 2) return out;
  Changes changes(e);
  const Rows faster = changes.faster_across();
  for (std::size_t gap = 0; gap + 1 < e.slices(); ++gap) {
    const Rows& within = changes.within(changes.gap_m(gap) / 2);
    for (std::size_t j = 0; j < within.size(); ++j) out.push_back(faster[j] * within[j]);
  }
  return out;
}

}  // namespace teletact::service
