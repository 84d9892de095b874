#include "bench/suites/link/felt.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "bench/suite.h"
#include "client/link/recording.h"
#include "client/render/contact_frame.h"
#include "client/servo/states.h"
#include "client/servo/tick_statistics.h"
#include "service/scene/touch_models.h"

namespace teletact::bench {
namespace {

using client::Vector3;

constexpr double kRampS = 0.6;      // of the force that comes on, and a little
constexpr std::size_t kStride = 3;  // of the ticks that are judged
constexpr double kNearM = 0.01, kTipReachM = 0.008;

std::shared_ptr<service::TouchedLayer> surface_of(const reference::TouchedTissue& tissue) {
  service::SceneGeometry geometry;
  geometry.width_m = tissue.grid.x_m.back();
  geometry.depth_m = tissue.grid.y_m.back();
  geometry.poisson_ratio = tissue.material.poisson_ratio;
  geometry.thickness_m = tissue.thickness_m;
  const service::ExplicitModulus modulus{tissue.grid.x_m, tissue.grid.y_m, tissue.material.youngs_modulus_pa};
  return service::tissue_models()->of_modulus(geometry, modulus, {})->layer(service::Layer{}, {}, {});
}

struct Ticks {
  std::vector<Vector3> felt_n, exact_n;
};

// By how many of the judged ticks what was felt comes after the exact force.
std::size_t lag_of(const Ticks& ticks) {
  constexpr std::size_t kMax = 200;
  std::size_t best = 0;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t lag = 0; lag < std::min(kMax, ticks.felt_n.size() / 2); ++lag) {
    double sum = 0;
    for (std::size_t k = kMax; k < ticks.felt_n.size(); ++k)
      sum += (ticks.felt_n[k] - ticks.exact_n[k - lag]).squaredNorm();
    if (sum < least) least = sum, best = lag;
  }
  return best;
}

// Of the columns that came, as the link would hear of them: only where they begin and end.
class Reach {
 public:
  explicit Reach(double width_m) : width_m_(width_m) {}
  void begin(double time_s) { begin_s_ = time_s; }
  void at(double x_m) { x_m_ = x_m; }
  void add(const v1::LawPiece& piece, double time_s) {
    for (const v1::LawColumn& column : piece.columns()) {
      from_m_ = std::min(from_m_, column.x_m());
      to_m_ = std::max(to_m_, column.x_m());
    }
    const bool all = from_m_ <= std::max(x_m_ - kNearM, 0.0) && to_m_ >= std::min(x_m_ + kNearM, width_m_);
    if (all && after_s_ < 0) after_s_ = time_s - begin_s_;
  }
  double after_s() const { return after_s_; }

 private:
  double width_m_, begin_s_ = 0, x_m_ = 0, after_s_ = -1;
  double from_m_ = std::numeric_limits<double>::infinity(), to_m_ = -from_m_;
};

}  // namespace

Felt felt_in(const std::string& recording, const reference::TouchedTissue& tissue) {
  const auto surface = surface_of(tissue);
  Felt felt;
  Ticks ticks;
  Reach reach(tissue.grid.x_m.back());
  std::vector<double> relative;
  double enabled_s = -1;
  std::size_t in_contact = 0, answers = 0;
  double begin_s = 0, end_s = 0;  // of the judged ticks
  client::RecordReader reader(recording);
  while (const auto entry = reader.next()) {
    const double time_s = 1e-9 * static_cast<double>(entry->monotonic_ns());
    if (entry->has_touch_request() && entry->touch_request().has_open()) reach.begin(time_s);
    if (entry->has_touch_response() && entry->touch_response().has_law())
      reach.add(entry->touch_response().law(), time_s);
    if (entry->has_touch_response() && entry->touch_response().has_answer()) answers += begin_s > 0;
    if (!entry->has_servo()) continue;
    const v1::ServoSample& tick = entry->servo();
    reach.at(tick.position_m(0));
    felt.min_energy_j = std::min(felt.min_energy_j, tick.energy_j());
    const bool on = tick.state() == static_cast<std::uint32_t>(client::ServoState::kEnabled);
    if (!on || enabled_s < 0) enabled_s = on ? time_s : -1;
    if (!on || time_s - enabled_s < kRampS || tick.position_m(1) <= 0 || ++in_contact % kStride != 0)
      continue;
    if (begin_s == 0) begin_s = time_s;
    end_s = time_s;
    const auto exact = surface->answer({}, {{tick.position_m(0), tick.position_m(1), 0}});
    const Vector3& exact_n = ticks.exact_n.emplace_back(Vector3::Map(exact.force_n.data()));
    const Vector3& felt_n = ticks.felt_n.emplace_back(tick.force_n(0), tick.force_n(1), tick.force_n(2));
    const double off_n = (felt_n - exact_n).norm(), size_n = exact_n.norm();
    felt.within_half += off_n <= 0.005 * size_n + 1e-3;
    felt.within_one += off_n <= 0.01 * size_n + 1e-3;
    felt.by_law_share += tick.by_law();
    relative.push_back(off_n / std::max(size_n, 1e-3));
  }
  if (relative.empty()) throw BenchError("no force was felt: is the service busy?");
  felt.ticks = relative.size();
  const auto count = static_cast<double>(felt.ticks);
  felt.within_half /= count, felt.within_one /= count, felt.by_law_share /= count;
  felt.answers_per_s = static_cast<double>(answers) / (end_s - begin_s);
  felt.error_p50 = client::percentile(relative, 0.5);
  felt.error_p95 = client::percentile(relative, 0.95);
  felt.lag_s = 0.001 * static_cast<double>(kStride * lag_of(ticks));
  felt.law_after_s = reach.after_s();
  return felt;
}

}  // namespace teletact::bench
