// Latencies of many, in buckets less than 1.6 % wide: what is read from it is off by less than 0.8 %. Those
// of several processes add up exactly.
#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <vector>

namespace teletact::bench {

class LatencyHistogram {
 public:
  void add(double seconds);  // below 0 counts as 0
  void add(const LatencyHistogram& other);
  std::uint64_t count() const { return count_; }
  double max_s() const { return max_s_; }
  // So much of all is at most this, s: 0 < q <= 1; NaN for none.
  double quantile(double q) const;
  // What the quantile of the population is below, s, with a confidence of 99 %: the order statistic that the
  // binomial distribution says (distribution-free; Hahn and Meeker 1991). None where there are too few: 459
  // for the 0.99-quantile.
  std::optional<double> bound(double q) const;
  // Of all, at most so many seconds: of each bucket that has one, increasing.
  struct Share {
    double seconds, at_most;
  };
  std::vector<Share> shares() const;

  friend void to_json(nlohmann::json&, const LatencyHistogram&);
  friend void from_json(const nlohmann::json&, LatencyHistogram&);

 private:
  double at_rank(std::uint64_t rank) const;       // 1: the least
  std::map<std::uint32_t, std::uint64_t> times_;  // of each bucket
  std::uint64_t count_ = 0;
  double max_s_ = 0;
};

}  // namespace teletact::bench
