// What a fuzz run draws from.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <random>

namespace teletact::bench {

class Source {
 public:
  explicit Source(std::uint64_t seed) : random_(seed) {}
  std::uint64_t one_of(std::uint64_t count) { return random_() % count; }
  bool happens(double probability) { return (distribution_(random_) + 1) / 2 < probability; }
  double between(double low, double high) { return low + (high - low) * (distribution_(random_) + 1) / 2; }
  // As likely in every decade.
  double logarithmic(double low, double high) { return low * std::pow(high / low, between(0, 1)); }
  double wild() {
    switch (one_of(9)) {
      case 8:
        return std::numeric_limits<double>::max() * (one_of(2) == 0 ? 1 : -1);
      case 0:
        return std::numeric_limits<double>::quiet_NaN();
      case 1:
        return std::numeric_limits<double>::infinity() * between(-1, 1);
      case 2:
        return 1e300 * between(-1, 1);
      case 3:
        return 0;
      default:
        return std::pow(10, between(-4, 4)) * between(-1, 1);
    }
  }

 private:
  std::mt19937_64 random_;
  std::uniform_real_distribution<double> distribution_{-1, 1};
};

}  // namespace teletact::bench
