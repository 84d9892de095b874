#include "service/base/current_trace.h"

#include <fmt/format.h>

#include <atomic>
#include <random>

namespace teletact::service {

namespace {

std::uint64_t random_seed() {
  std::random_device device;
  return static_cast<std::uint64_t>(device()) << 32 | device();
}

// `digits`: at most 16. Capital ones are not allowed by the standard.
std::optional<std::uint64_t> from_hex(std::string_view digits) {
  std::uint64_t value = 0;
  for (const char c : digits) {
    const bool number = c >= '0' && c <= '9';
    if (!number && !(c >= 'a' && c <= 'f')) return std::nullopt;
    value = value << 4 | static_cast<std::uint64_t>(number ? c - '0' : c - 'a' + 10);
  }
  return value;
}

// version-trace-parent-flags; a later version may have more behind another dash.
std::optional<TraceId> read(std::string_view text) {
  constexpr std::size_t kVersion = 0, kTrace = 3, kParent = 36, kFlags = 53, kLength = 55;
  constexpr std::uint64_t kNoVersion = 0xff;
  if (text.size() < kLength || text[kTrace - 1] != '-' || text[kParent - 1] != '-' || text[kFlags - 1] != '-')
    return std::nullopt;
  const auto version = from_hex(text.substr(kVersion, 2)), flags = from_hex(text.substr(kFlags, 2));
  const auto high = from_hex(text.substr(kTrace, 16)), low = from_hex(text.substr(kTrace + 16, 16));
  const auto parent = from_hex(text.substr(kParent, 16));
  if (!version || !flags || !high || !low || !parent || *version == kNoVersion) return std::nullopt;
  if (text.size() > kLength && (*version == 0 || text[kLength] != '-')) return std::nullopt;
  const TraceId trace{*high, *low};
  if (!trace || *parent == 0) return std::nullopt;
  return trace;
}

// splitmix64: each number once.
std::uint64_t new_number() {
  constexpr std::uint64_t kStep = 0x9e3779b97f4a7c15;
  static std::atomic<std::uint64_t> state{random_seed()};
  std::uint64_t z = state.fetch_add(kStep, std::memory_order_relaxed) + kStep;
  z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9;
  z = (z ^ z >> 27) * 0x94d049bb133111eb;
  return z ^ z >> 31;
}

}  // namespace

std::string hex(const TraceId& id) {
  return fmt::format("{:016x}{:016x}", id.high, id.low);
}

// Of two numbers in a row one at most is 0.
TraceId trace_of(std::optional<std::string_view> traceparent) {
  if (traceparent)
    if (const auto given = read(*traceparent)) return *given;
  return {new_number(), new_number()};
}

namespace {

thread_local TraceId current;

}  // namespace

TraceId current_trace() {
  return current;
}

InTrace::InTrace(const TraceId& trace) : before_(current) {
  current = trace;
}

InTrace::~InTrace() {
  current = before_;
}

}  // namespace teletact::service
