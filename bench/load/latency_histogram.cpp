#include "bench/load/latency_histogram.h"

#include <algorithm>
#include <bit>
#include <boost/math/distributions/binomial.hpp>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

namespace teletact::bench {
namespace {

constexpr int kBits = 6;  // 64 buckets for each doubling
constexpr std::uint64_t kEach = 1U << kBits;
constexpr double kConfidence = 0.99;

std::uint32_t bucket_of(std::uint64_t ns) {
  if (ns < kEach) return static_cast<std::uint32_t>(ns);
  const int shift = std::bit_width(ns) - 1 - kBits;
  return static_cast<std::uint32_t>((shift + 1) * kEach + ((ns >> shift) - kEach));
}

// The middle of a bucket.
double seconds_of(std::uint32_t bucket) {
  if (bucket < kEach) return 1e-9 * bucket;
  const auto shift = static_cast<int>(bucket / kEach) - 1;
  return 1e-9 * std::ldexp(static_cast<double>(kEach + bucket % kEach) + 0.5, shift);
}

}  // namespace

void LatencyHistogram::add(double seconds) {
  seconds = std::max(seconds, 0.0);
  ++times_[bucket_of(static_cast<std::uint64_t>(seconds * 1e9))];
  ++count_;
  max_s_ = std::max(max_s_, seconds);
}

void LatencyHistogram::add(const LatencyHistogram& other) {
  for (const auto& [bucket, times] : other.times_) times_[bucket] += times;
  count_ += other.count_;
  max_s_ = std::max(max_s_, other.max_s_);
}

double LatencyHistogram::at_rank(std::uint64_t rank) const {
  std::uint64_t so_far = 0;
  for (const auto& [bucket, times] : times_)
    if ((so_far += times) >= rank) return std::min(seconds_of(bucket), max_s_);
  return std::numeric_limits<double>::quiet_NaN();
}

double LatencyHistogram::quantile(double q) const {
  const double rank = std::ceil(q * static_cast<double>(count_));
  return at_rank(static_cast<std::uint64_t>(std::max(rank, 1.0)));
}

std::optional<double> LatencyHistogram::bound(double q) const {
  if (count_ == 0) return std::nullopt;
  using Policy = boost::math::policies::policy<
      boost::math::policies::discrete_quantile<boost::math::policies::integer_round_up>>;
  const boost::math::binomial_distribution<double, Policy> below(static_cast<double>(count_), q);
  const auto rank = static_cast<std::uint64_t>(boost::math::quantile(below, kConfidence)) + 1;
  if (rank > count_) return std::nullopt;
  return rank == count_ ? max_s_ : at_rank(rank);
}

std::vector<LatencyHistogram::Share> LatencyHistogram::shares() const {
  std::vector<Share> out;
  std::uint64_t so_far = 0;
  for (const auto& [bucket, times] : times_) {
    so_far += times;
    out.push_back(
        {std::min(seconds_of(bucket), max_s_), static_cast<double>(so_far) / static_cast<double>(count_)});
  }
  return out;
}

void to_json(nlohmann::json& json, const LatencyHistogram& of) {
  nlohmann::json buckets = nlohmann::json::array();
  for (const auto& [bucket, times] : of.times_) buckets.push_back({bucket, times});
  json = {{"max_s", of.max_s_}, {"buckets", buckets}};
}

void from_json(const nlohmann::json& json, LatencyHistogram& of) {
  of = {};
  json.at("max_s").get_to(of.max_s_);
  for (const nlohmann::json& pair : json.at("buckets")) {
    const auto times = pair.at(1).get<std::uint64_t>();
    of.times_[pair.at(0).get<std::uint32_t>()] += times;
    of.count_ += times;
  }
}

}  // namespace teletact::bench
