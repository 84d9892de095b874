// Random numbers that are the same on every machine for one seed: the standard fixes its engine's output, not
// that of its distributions or of std::shuffle.
#pragma once

#include <cstdint>
#include <random>
#include <utility>
#include <vector>

namespace teletact::client {

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  // In [0, 1), 53 bits.
  double uniform() { return static_cast<double>(engine_() >> 11) * 0x1p-53; }
  bool happens(double probability) { return uniform() < probability; }
  std::uint64_t seed() { return engine_(); }  // for another generator
  template <typename T>
  void shuffle(std::vector<T>& values) {  // Fisher and Yates
    for (std::size_t k = values.size(); k > 1; --k) {
      const auto other = static_cast<std::size_t>(uniform() * static_cast<double>(k));
      std::swap(values[k - 1], values[other]);
    }
  }

 private:
  std::mt19937_64 engine_;
};

}  // namespace teletact::client
