#include "client/report/force_error.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "client/patient/parallel.h"
#include "client/servo/tick_statistics.h"

namespace teletact::client {
namespace {

constexpr double kEveryS = 0.01;     // the path is sampled so often
constexpr double kStartRampS = 0.5;  // after force comes on it is ramped: not judged
constexpr double kMinForceN = 0.05;  // relative errors are taken where the true force exceeds this

ForceSamplePoint felt(const TouchRecord& record, const TouchTick& tick) {
  ForceSamplePoint point;
  point.time_s = tick.time_s;
  point.x_m = tick.x_m;
  point.indentation_m = tick.indentation_m;
  point.felt_n = -tick.force_y_n;
  if (tick.enabled && tick.indentation_m > 0) point.stated = stated_interval(record, tick);
  return point;
}

ForceSamplePoint compare(const Patient& patient, const TouchRecord& record, const TouchTick& tick) {
  ForceSamplePoint point = felt(record, tick);
  point.true_n = 0;
  if (tick.indentation_m <= 0 || tick.x_m < 0 || tick.x_m > patient.tissue().width_m) return point;
  const TouchForce truth = patient.touch(record.finger, tick.x_m, tick.indentation_m);
  point.true_n = -truth.force_n[1];
  const double size = std::hypot(truth.force_n[0], truth.force_n[1]);
  point.judged = tick.enabled && size > kMinForceN;
  if (point.judged)
    point.relative_error =
        std::hypot(tick.force_x_n - truth.force_n[0], tick.force_y_n - truth.force_n[1]) / size;
  return point;
}

}  // namespace

std::vector<TouchTick> felt_path(const std::vector<TouchTick>& ticks) {
  const auto touches = [](const TouchTick& tick) { return tick.enabled && tick.indentation_m > 0; };
  const auto first = std::find_if(ticks.begin(), ticks.end(), touches);
  const auto last = std::find_if(ticks.rbegin(), ticks.rend(), touches).base();
  std::vector<TouchTick> path;
  bool was_enabled = false;
  double enabled_since_s = 0, next_s = 0;
  for (auto tick = ticks.begin(); tick < last; ++tick) {
    if (tick->enabled && !was_enabled) enabled_since_s = tick->time_s;
    was_enabled = tick->enabled;
    const bool in_ramp = tick->enabled && tick->time_s < enabled_since_s + kStartRampS;
    if (tick < first || in_ramp || tick->time_s < next_s) continue;
    next_s = tick->time_s + kEveryS;
    path.push_back(*tick);
  }
  return path;
}

std::vector<ForceSamplePoint> felt_force(const TouchRecord& record) {
  std::vector<ForceSamplePoint> points;
  for (const TouchTick& tick : felt_path(record.ticks)) points.push_back(felt(record, tick));
  return points;
}

ForceError force_error(const Patient& patient, const TouchRecord& record) {
  if (!record.untold.empty()) throw std::runtime_error(record.untold);
  if (record.layer_depth_m > patient.mesh().y_m.at(1) / 2)
    throw std::runtime_error("an interior layer was touched; only the surface's true force is known");
  const std::vector<TouchTick> path = felt_path(record.ticks);
  ForceError result;
  result.samples.resize(path.size());
  in_parallel(path.size(), [&](std::size_t i) { result.samples[i] = compare(patient, record, path[i]); });
  std::vector<double> errors;
  for (const ForceSamplePoint& point : result.samples)
    if (point.judged) errors.push_back(point.relative_error);
  if (errors.empty())
    throw std::runtime_error("the finger never felt the tissue: there is no force to judge");
  result.judged = errors.size();
  result.coverage = static_cast<double>(errors.size()) / static_cast<double>(path.size());
  result.median = percentile(errors, 0.5);
  result.p95 = percentile(errors, 0.95);
  return result;
}

}  // namespace teletact::client
