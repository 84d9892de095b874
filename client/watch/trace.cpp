#include "client/watch/trace.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "client/clock/clock.h"

namespace teletact::client {
namespace {

enum Column {
  kT,
  kX,
  kY,
  kZ,
  kFx,
  kFy,
  kFz,
  kHalf,
  kLate,
  kPeriod,
  kAge,
  kSilence,
  kRound,
  kModulus,
  kFlags,
  kReason,
  kBalance,
  kClaim,
  kLacks,
  kWithheld,
  kAbove
};

float at(const google::protobuf::RepeatedField<double>& vector, int index) {
  return vector.size() > index ? static_cast<float>(vector.Get(index)) : 0;
}

// Bits 0 and 1: the state.
float flags_of(const v1::ServoSample& tick) {
  constexpr unsigned kState = 3, kByLaw = 4, kDegraded = 8, kByService = 16, kFaded = 32, kBorder = 64,
                     kDebt = 128;
  return static_cast<float>((tick.state() & kState) | (tick.by_law() ? kByLaw : 0) |
                            (tick.degraded() ? kDegraded : 0) | (tick.service_degraded() ? kByService : 0) |
                            (tick.faded() ? kFaded : 0) | (tick.at_border() ? kBorder : 0) |
                            (tick.indebted() ? kDebt : 0));
}

void largest(float& of, double value) {
  of = std::max(of, static_cast<float>(value));
}

}  // namespace

const std::array<const char*, Trace::kColumns>& Trace::columns() {
  static const std::array<const char*, kColumns> names{
      "t_s",           "x_m",           "y_m",        "z_m",      "force_x_n",   "force_y_n",
      "force_z_n",     "half_width",    "lateness_s", "period_s", "model_age_s", "silence_s",
      "round_trip_s",  "modulus_age_s", "flags",      "reason",   "balance_j",   "claim",
      "claim_lacks_j", "withheld",      "above"};
  return names;
}

void Trace::clear() {
  *this = Trace();
}

bool Trace::complete() {
  if (!std::exchange(open_, false)) return false;
  rows_.push_back(row_);
  if (rows_.size() > static_cast<std::size_t>(kKeptS / kRowS)) {
    rows_.pop_front();
    ++first_;
  }
  return true;
}

bool Trace::add(std::int64_t time_ns, const v1::ServoSample& tick,
                const std::optional<v1::ForceBudget>& budget) {
  if (!begin_ns_) begin_s_ = seconds(*(begin_ns_ = time_ns));
  const double t_s = seconds_between(*begin_ns_, time_ns);
  const bool follows = open_, completes = follows && t_s >= row_s_ + kRowS && complete();
  if (!open_) {
    row_ = Row{};
    row_s_ = t_s;
  }
  if (follows) largest(row_[kPeriod], t_s - last_s_);
  open_ = true;
  last_s_ = t_s;
  row_[kT] = static_cast<float>(t_s);
  for (int axis = 0; axis < 3; ++axis) {
    row_[kX + axis] = at(tick.position_m(), axis);
    row_[kFx + axis] = at(tick.force_n(), axis);
  }
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  row_[kHalf] = static_cast<float>(budget ? budget->half_width() : kNone);
  row_[kAbove] = static_cast<float>(budget ? budget->above() : kNone);
  largest(row_[kLate], tick.lateness_s());
  largest(row_[kAge], tick.model_age_s());
  largest(row_[kSilence], tick.silence_s());
  row_[kRound] = static_cast<float>(tick.round_trip_s());
  row_[kModulus] = static_cast<float>(tick.modulus_age_s());
  row_[kFlags] = flags_of(tick);
  row_[kReason] = static_cast<float>(tick.reason());
  row_[kBalance] = static_cast<float>(tick.has_balance_j() ? tick.balance_j() : kNone);
  row_[kClaim] = static_cast<float>(tick.claim());
  row_[kLacks] = static_cast<float>(tick.claim_lacks_j());
  row_[kWithheld] = static_cast<float>(tick.withheld());
  return completes;
}

Slot Trace::slot(std::uint64_t from) const {
  from = std::clamp(from, first_, rows());
  std::vector<float> values;
  values.reserve((rows() - from) * kColumns);
  for (auto row = rows_.begin() + static_cast<std::ptrdiff_t>(from - first_); row != rows_.end(); ++row)
    values.insert(values.end(), row->begin(), row->end());
  Slot out({{"begin_s", begin_s_}, {"first", from}, {"columns", columns()}});
  out.add("rows", {values.size() / kColumns, kColumns}, values);
  return out;
}

}  // namespace teletact::client
