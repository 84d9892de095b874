#include "bench/peers/line_path.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <tuple>
#include <utility>

namespace teletact::bench {
namespace {

using reference::RfImage;

constexpr int kRun = 4;          // samples that share one lag
constexpr int kBesideReach = 6;  // samples around the lag of the line before

// One line's table: axial lags first[r] .. first[r] + axial_count - 1 at run r, lateral lags -reach .. reach.
class LinePath {
 public:
  LinePath(const RfImage& pre, const RfImage& post, int line, const PathOptions& options)
      : pre_(pre), post_(post), line_(line), options_(options), runs_((pre.samples + kRun - 1) / kRun) {
    laterals_ = 2 * options.lateral_reach + 1;
  }

  // `beside`: lags per run of the line before, empty for the first line. Lags per run, axial and lateral.
  std::vector<std::pair<int, int>> find(const std::vector<std::pair<int, int>>& beside) {
    axials_ = beside.empty() ? 2 * options_.axial_reach + 1 : 2 * kBesideReach + 1;
    const std::size_t states = static_cast<std::size_t>(axials_) * static_cast<std::size_t>(laterals_);
    std::vector<double> cost(states, 0.0), next(states);
    from_.assign(states * static_cast<std::size_t>(runs_), 4);
    for (int r = 0; r < runs_; ++r) {
      for (int a = 0; a < axials_; ++a)
        for (int l = 0; l < laterals_; ++l)
          next[state(a, l)] = mismatch(r, a, l, beside) + (r > 0 ? reach(cost, r, a, l, beside) : 0);
      std::swap(cost, next);
    }
    return trace(cost, beside);
  }

 private:
  std::size_t state(int a, int l) const { return static_cast<std::size_t>(a * laterals_ + l); }
  int first(int r, const std::vector<std::pair<int, int>>& beside) const {
    return beside.empty() ? -options_.axial_reach : beside[static_cast<std::size_t>(r)].first - kBesideReach;
  }

  double mismatch(int r, int a, int l, const std::vector<std::pair<int, int>>& beside) const {
    const int axial = first(r, beside) + a, lateral = l - options_.lateral_reach;
    const int begin = r * kRun, end = std::min(pre_.samples, begin + kRun);
    if (std::abs(axial) > options_.max_strain * (options_.first_sample + end) + 2)
      return std::numeric_limits<double>::infinity();
    double sum = 0;
    for (int k = begin; k < end; ++k)
      sum += std::abs(pre_.at(k, line_) - post_.at(k + axial, line_ + lateral));
    if (beside.empty()) return sum;
    const auto& [a0, l0] = beside[static_cast<std::size_t>(r)];
    return sum + options_.step_cost * (std::pow(axial - a0, 2) + std::pow(lateral - l0, 2));
  }

  // The cheapest way here from the nine lags around in the run before.
  double reach(const std::vector<double>& before, int r, int a, int l,
               const std::vector<std::pair<int, int>>& beside) {
    const int moved = first(r, beside) - first(r - 1, beside);
    double best = std::numeric_limits<double>::infinity();
    for (int da = -1; da <= 1; ++da)
      for (int dl = -1; dl <= 1; ++dl) {
        const int pa = a + moved + da, pl = l + dl;
        if (pa < 0 || pa >= axials_ || pl < 0 || pl >= laterals_) continue;
        const double c = before[state(pa, pl)] + options_.step_cost * (da * da + dl * dl);
        if (!(c < best)) continue;
        best = c;
        from_[static_cast<std::size_t>(r) * before.size() + state(a, l)] =
            static_cast<std::uint8_t>(3 * (da + 1) + dl + 1);
      }
    return best;
  }

  std::vector<std::pair<int, int>> trace(const std::vector<double>& cost,
                                         const std::vector<std::pair<int, int>>& beside) const {
    const auto end = std::min_element(cost.begin(), cost.end()) - cost.begin();
    int a = static_cast<int>(end) / laterals_, l = static_cast<int>(end) % laterals_;
    std::vector<std::pair<int, int>> lags(static_cast<std::size_t>(runs_));
    for (int r = runs_ - 1; r >= 0; --r) {
      lags[static_cast<std::size_t>(r)] = {first(r, beside) + a, l - options_.lateral_reach};
      if (r == 0) break;
      const int way = from_[static_cast<std::size_t>(r) * cost.size() + state(a, l)];
      a = std::clamp(a + first(r, beside) - first(r - 1, beside) + way / 3 - 1, 0, axials_ - 1);
      l = std::clamp(l + way % 3 - 1, 0, laterals_ - 1);
    }
    return lags;
  }

  const RfImage &pre_, &post_;
  int line_;
  const PathOptions& options_;
  int runs_, axials_ = 0, laterals_ = 0;
  std::vector<std::uint8_t> from_;
};

}  // namespace

Paths find_line_paths(const RfImage& pre, const RfImage& post, const PathOptions& options) {
  Paths paths{std::vector<int>(pre.values.size()), std::vector<int>(pre.values.size())};
  const auto keep = [&](int line, const std::vector<std::pair<int, int>>& lags) {
    for (int k = 0; k < pre.samples; ++k) {
      const auto n = static_cast<std::size_t>(k + pre.samples * line);
      std::tie(paths.axial[n], paths.lateral[n]) = lags[static_cast<std::size_t>(k / kRun)];
    }
  };
  const int seed = pre.lines / 2;
  const auto middle = LinePath(pre, post, seed, options).find({});
  keep(seed, middle);
  for (const int direction : {-1, 1}) {
    auto lags = middle;
    for (int line = seed + direction; line >= 0 && line < pre.lines; line += direction) {
      lags = LinePath(pre, post, line, options).find(lags);
      keep(line, lags);
    }
  }
  return paths;
}

}  // namespace teletact::bench
