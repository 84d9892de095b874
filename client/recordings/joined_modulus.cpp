#include "client/recordings/joined_modulus.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace teletact::client {
namespace {

constexpr double kMinQuality = 0.6;  // of the best pair's
constexpr double kMaxApart = 2;      // stated deviations from the others, median over the nodes
constexpr double kReachM = 5e-3;     // to each side, over which pairs are compared: errors are alike nearby
constexpr double kMaxOwnPart = 0.5;  // of the stated variance: speckle, face, depth and model are one
constexpr double kDifferMuch = 2;    // times the stated variance
constexpr std::size_t kCompared = 4000;  // nodes, about, that pairs are compared by

double middle_of(std::vector<double>& values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

bool told(const PairModulus& pair, std::size_t n) {
  return std::isfinite(pair.log_modulus[n]) && pair.log_deviation[n] > 0 &&
         std::isfinite(pair.log_deviation[n]);
}

// One map of several pairs, each less its level.
class Joint {
 public:
  Joint(const std::vector<PairModulus>& pairs, std::vector<PairUse>& use) : pairs_(pairs), use_(use) {}

  bool in(std::size_t p) const { return use_[p].left_out.empty(); }
  double value(std::size_t p, std::size_t n) const {
    return pairs_[p].log_modulus[n] - std::log(use_[p].level);
  }
  // Median over the pairs but `without`; NaN where none says anything.
  double typical(std::size_t n, std::size_t without) const {
    std::vector<double> values;
    for (std::size_t p = 0; p < pairs_.size(); ++p)
      if (p != without && in(p) && told(pairs_[p], n)) values.push_back(value(p, n));
    if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
    std::sort(values.begin(), values.end());
    const std::size_t k = values.size() / 2;
    return values.size() % 2 == 1 ? values[k] : 0.5 * (values[k - 1] + values[k]);
  }
  // Of pair p over the others: ln of its level.
  double level(std::size_t p) const {
    return median_of(p, [](double difference, double) { return difference; });
  }
  // In stated deviations.
  double apart(std::size_t p) const {
    return median_of(p, [](double difference, double deviation) { return std::abs(difference) / deviation; });
  }

 private:
  template <class Measure>
  double median_of(std::size_t p, const Measure& measure) const {
    std::vector<double> values;
    const std::size_t step = std::max<std::size_t>(1, pairs_[p].log_modulus.size() / kCompared);
    for (std::size_t n = 0; n < pairs_[p].log_modulus.size(); n += step)
      if (told(pairs_[p], n))
        if (const double others = typical(n, p); std::isfinite(others))
          values.push_back(measure(value(p, n) - others, pairs_[p].log_deviation[n]));
    return middle_of(values);
  }
  const std::vector<PairModulus>& pairs_;
  std::vector<PairUse>& use_;
};

std::size_t count_used(const std::vector<PairUse>& use) {
  return static_cast<std::size_t>(
      std::count_if(use.begin(), use.end(), [](const PairUse& u) { return u.left_out.empty(); }));
}

void match_levels(const Joint& joint, std::vector<PairUse>& use) {
  constexpr int kRounds = 3;
  for (int round = 0; round < kRounds; ++round)
    for (std::size_t p = 0; p < use.size(); ++p)
      if (joint.in(p)) use[p].level *= std::exp(joint.level(p));
}

void choose(const std::vector<PairModulus>& pairs, bool absolute, std::vector<PairUse>& use) {
  double best = 0;
  for (const PairModulus& pair : pairs) best = std::max(best, pair.quality);
  for (std::size_t p = 0; p < pairs.size(); ++p)
    if (pairs[p].quality < kMinQuality * best)
      use[p].left_out = fmt::format("quality {:.2f} where the best pair has {:.2f}", pairs[p].quality, best);
  const Joint joint(pairs, use);
  if (!absolute) match_levels(joint, use);
  while (count_used(use) > 2) {  // of two that differ neither is known to be wrong
    std::size_t worst = 0;
    double most = 0;
    for (std::size_t p = 0; p < pairs.size(); ++p)
      if (joint.in(p))
        if (const double apart = joint.apart(p); apart > most) most = apart, worst = p;
    if (!(most > kMaxApart)) break;
    use[worst].left_out = fmt::format(
        "differs from the other pairs by {:.1f} of its deviations (median){}", most,
        absolute ? fmt::format(", {:.2f} times their modulus", std::exp(joint.level(worst))) : "");
    if (!absolute) match_levels(joint, use);
  }
}

// Sums over the rectangle about each node.
std::vector<double> summed_around(const std::vector<double>& values, const MapNodes& nodes) {
  std::vector<double> table((nodes.nx + 1) * (nodes.ny + 1), 0.0);
  const auto at = [&](std::size_t i, std::size_t j) -> double& { return table[i + (nodes.nx + 1) * j]; };
  for (std::size_t j = 0; j < nodes.ny; ++j)
    for (std::size_t i = 0; i < nodes.nx; ++i)
      at(i + 1, j + 1) = values[i + nodes.nx * j] + at(i, j + 1) + at(i + 1, j) - at(i, j);
  const auto reach_x = static_cast<std::size_t>(kReachM / nodes.dx_m);
  const auto reach_y = static_cast<std::size_t>(kReachM / nodes.dy_m);
  std::vector<double> out(values.size());
  for (std::size_t j = 0; j < nodes.ny; ++j)
    for (std::size_t i = 0; i < nodes.nx; ++i) {
      const std::size_t left = i > reach_x ? i - reach_x : 0, right = std::min(nodes.nx, i + reach_x + 1);
      const std::size_t top = j > reach_y ? j - reach_y : 0, bottom = std::min(nodes.ny, j + reach_y + 1);
      out[i + nodes.nx * j] = at(right, bottom) - at(left, bottom) - at(right, top) + at(left, top);
    }
  return out;
}

// Of one node over the pairs that tell it.
struct Sums {
  double w = 0, w_s = 0, w_c = 0, w_x = 0;  // weight, x deviation, x its shared part, x value
  std::size_t count = 0;
  double mean() const { return w_x / w; }
};

}  // namespace

JoinedModulus join_moduli(const MapNodes& nodes, const std::vector<PairModulus>& pairs, bool absolute) {
  const std::size_t size = nodes.nx * nodes.ny;
  if (pairs.empty()) throw std::invalid_argument("there is no pair to be joined");
  if (!(nodes.dx_m > 0 && nodes.dy_m > 0)) throw std::invalid_argument("spacing of the nodes");
  for (const PairModulus& pair : pairs)
    if (pair.log_modulus.size() != size || pair.log_deviation.size() != size)
      throw std::invalid_argument("a pair's modulus does not fill the nodes");
  JoinedModulus out;
  out.pairs.resize(pairs.size());
  choose(pairs, absolute, out.pairs);
  out.used = count_used(out.pairs);
  const Joint joint(pairs, out.pairs);

  std::vector<Sums> sums(size);
  std::vector<double> squares(size), freedom(size);
  for (std::size_t n = 0; n < size; ++n) {
    Sums& s = sums[n];
    for (std::size_t p = 0; p < pairs.size(); ++p)
      if (joint.in(p) && told(pairs[p], n)) {
        const double deviation = pairs[p].log_deviation[n], w = 1 / (deviation * deviation);
        s.w += w, s.w_s += w * deviation, s.w_c += w * pairs[p].shared_deviation,
            s.w_x += w * joint.value(p, n), ++s.count;
      }
    if (s.count < 2) continue;
    for (std::size_t p = 0; p < pairs.size(); ++p)
      if (joint.in(p) && told(pairs[p], n))
        squares[n] += std::pow((joint.value(p, n) - s.mean()) / pairs[p].log_deviation[n], 2);
    freedom[n] = static_cast<double>(s.count - 1);
  }
  const std::vector<double> squares_around = summed_around(squares, nodes);
  const std::vector<double> freedom_around = summed_around(freedom, nodes);

  const auto nowhere = std::numeric_limits<float>::quiet_NaN();
  out.log_modulus.assign(size, nowhere);
  out.log_deviation.assign(size, nowhere);
  std::vector<double> all, one, scatter, shared, part;
  for (std::size_t n = 0; n < size; ++n) {
    const Sums& s = sums[n];
    if (s.count == 0) continue;
    out.log_modulus[n] = static_cast<float>(s.mean());
    all.push_back(s.mean());
    const double stated = s.w_s / s.w;  // of the mean, were the pairs' errors the same
    double common = stated * stated, own = 0;
    if (s.count > 1) {
      const double differing = squares_around[n] / freedom_around[n];
      common = std::max(common * (1 - std::min(differing, kMaxOwnPart)), std::pow(s.w_c / s.w, 2));
      own = differing / s.w;
      one.push_back(stated), scatter.push_back(std::sqrt(differing) * stated);
      shared.push_back(std::sqrt(common)), part.push_back(differing);
    }
    out.log_deviation[n] = static_cast<float>(std::sqrt(common + own));
  }
  out.of_one = middle_of(one), out.scatter = middle_of(scatter), out.shared = middle_of(shared);
  out.part = middle_of(part);
  out.differ = out.part > kDifferMuch;
  if (!absolute)
    for (const double middle = middle_of(all); float& value : out.log_modulus)
      value -= static_cast<float>(middle);
  for (std::size_t p = 0; p < pairs.size(); ++p) {
    if (!joint.in(p)) continue;
    std::vector<double> shares;
    for (std::size_t n = 0; n < size; ++n)
      if (told(pairs[p], n)) shares.push_back(1 / (std::pow(pairs[p].log_deviation[n], 2) * sums[n].w));
    out.pairs[p].share = middle_of(shares);
    if (absolute) out.pairs[p].level = out.used > 1 ? std::exp(joint.level(p)) : 1;
  }
  return out;
}

}  // namespace teletact::client
