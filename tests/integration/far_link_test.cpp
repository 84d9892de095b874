// A finger that explores an inclusion through a link with a long round trip: felt by the tissue's contact
// law, the force is the model's at the finger's own place, not at where it was.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "client/link/touch_link.h"
#include "client/render/renderers.h"
#include "client/servo/servo_thread.h"
#include "client/servo/tick_statistics.h"
#include "service/contact/solid_contact.h"
#include "service/device/device.h"
#include "service/scene/tissue_models.h"
#include "service/scene/touch_models.h"
#include "tests/rpc/running_server.h"
#include "tests/support/fault_proxy.h"

namespace teletact {
namespace {

constexpr double kWidthM = 0.12, kDepthM = 0.04;

// 10 kPa with a stiff inclusion of 10 mm, on elements of 1 mm.
service::ExplicitModulus tissue() {
  service::ExplicitModulus modulus;
  for (int i = 0; i <= 120; ++i) modulus.x_m.push_back(1e-3 * i);
  for (int j = 0; j <= 40; ++j) modulus.y_m.push_back(1e-3 * j);
  for (int j = 0; j < 40; ++j)
    for (int i = 0; i < 120; ++i) {
      const double off_m = std::hypot(1e-3 * i - 0.06, 1e-3 * j - 0.010);
      modulus.youngs_modulus_pa.push_back(off_m < 0.005 ? 50e3 : 10e3);
    }
  return modulus;
}

// A ball of 10 mm and contrast 5 in a solid of 10 kPa.
float ball_pa(double x_m, double y_m, double z_m) {
  return std::hypot(x_m - 0.02, y_m - 0.008, z_m) < 0.005 ? 50e3F : 10e3F;
}

v1::CreateSceneRequest scene_request() {
  const service::ExplicitModulus modulus = tissue();
  v1::CreateSceneRequest request;
  request.set_scene_id("s");
  request.mutable_geometry()->add_size_m(kWidthM);
  request.mutable_geometry()->add_size_m(kDepthM);
  v1::ModulusMap& map = *request.mutable_modulus();
  map.mutable_x_m()->Assign(modulus.x_m.begin(), modulus.x_m.end());
  map.mutable_y_m()->Assign(modulus.y_m.begin(), modulus.y_m.end());
  v1::Array& array = *map.mutable_youngs_modulus_pa();
  array.set_dtype(v1::DATA_TYPE_FLOAT64);
  array.add_shape(40);
  array.add_shape(120);
  array.set_data(modulus.youngs_modulus_pa.data(), modulus.youngs_modulus_pa.size() * sizeof(double));
  return request;
}

// Where a hand sweeps, and what it should feel.
struct Place {
  std::string scene_id;
  double begin_m, end_m, aside_m;  // x between two ends; z to both sides
  double share, floor_n;           // that a force may be off by
  std::size_t every;               // of the ticks that are held against
  std::function<service::ContactAnswer(const service::Vector3&)> exact;
};

// Presses once force is on, then sweeps to and fro at 120 mm/s while its depth breathes between 2 and 4 mm
// and its other place more slowly.
class SweepingDevice final : public client::HapticDevice {
 public:
  static constexpr double kSpeedMS = 0.12, kSettleS = 1.5;
  struct Felt {
    service::Vector3 position_m;
    client::Vector3 force_n;
  };
  explicit SweepingDevice(const Place& place) : place_(place), x_m_(place.begin_m) { felt.reserve(100'000); }
  const client::DeviceProfile& profile() const noexcept override {
    return client::device_profile("premium-1.5");
  }
  void open() override {}
  void close() noexcept override {}
  bool read(std::int64_t now_ns, client::DeviceReading& reading) noexcept override {
    const double dt_s = last_ns_ == 0 ? 0 : std::min(1e-9 * double(now_ns - last_ns_), 0.01);
    last_ns_ = now_ns;
    if (force_on_) {
      on_s_ += dt_s;
      x_m_ += direction_ * kSpeedMS * dt_s;
      if (x_m_ > place_.end_m || x_m_ < place_.begin_m) direction_ = x_m_ > place_.end_m ? -1 : 1;
      z_m_ = place_.aside_m * std::sin(3 * on_s_);
    }
    const double wanted_m = force_on_ ? 0.003 + 0.001 * std::sin(5 * on_s_) : -0.002;
    d_m_ += std::clamp(wanted_m - d_m_, -0.02 * dt_s, 0.02 * dt_s);
    reading.pose.position_m = {x_m_, d_m_, z_m_};
    reading.pose.velocity_m_s.setZero();
    reading.resume_pressed = !force_on_ && ++reads_ % 100 >= 50;
    return true;
  }
  bool write(const client::Vector3& force_n) noexcept override {
    if (on_s_ > kSettleS && felt.size() < felt.capacity()) felt.push_back({{x_m_, d_m_, z_m_}, force_n});
    return true;
  }
  void show(const client::OperatorView& view) noexcept override { force_on_ = view.force_on; }
  std::vector<Felt> felt;

 private:
  const Place& place_;
  double x_m_, d_m_ = -0.002, z_m_ = 0, direction_ = 1, on_s_ = 0;
  std::int64_t last_ns_ = 0;
  unsigned reads_ = 0;
  bool force_on_ = false;
};

struct Explored {
  double share_in_tolerance = 0, p95 = 0;  // of the ticks; error over what it may be
  double by_law_share = 0;
  double lost_s = 0, faded_s = 0, degraded_s = 0;
  double answers_per_s = 0;
  double bytes_per_s = 0;  // both ways
};

class FarLink : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    server = std::make_unique<service::RunningServer>();
    (*server)->make_ready();
    ASSERT_TRUE(server->create(scene_request()).ok());
    ASSERT_TRUE(server->create(service::solid_scene("solid", 10, 12, ball_pa)).ok());
  }
  static void TearDownTestSuite() { server.reset(); }
  static Explored explore(const Place& place, const std::string& renderer, double round_trip_s);
  static inline std::unique_ptr<service::RunningServer> server;
};

Explored FarLink::explore(const Place& place, const std::string& renderer, double round_trip_s) {
  test::FaultProxy proxy((*server)->address());
  proxy.play({.kind = test::FaultEvent::Kind::kFaults,
              .faults = {.up = {.delay_s = round_trip_s / 2}, .down = {.delay_s = round_trip_s / 2}}});
  SweepingDevice device(place);
  client::ServoOptions options;
  options.chain.limits = device.profile().limits();
  const auto rendered = client::make_renderer(renderer, options.period_s, options.chain.limits);
  client::MonotonicClock clock;
  const auto servo = std::make_unique<client::ServoLoop>(device, *rendered, clock, options);
  client::TouchLinkOptions link_options;
  link_options.address = proxy.address();
  link_options.open = service::Toucher::open_on(place.scene_id);
  link_options.open.set_credit(256);
  if (renderer == "law") link_options.laws = &servo->laws();
  client::TouchLink link(link_options, servo->poses(), servo->answers(), clock);
  client::TickStatistics ticks;
  double bytes = 0;
  {
    client::ServoThread thread(*servo, {.real_time = false});
    link.start();
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(8);
    while (std::chrono::steady_clock::now() < end) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      for (client::ServoTick tick; servo->telemetry().pop(tick);) ticks.add(tick);
    }
    bytes = double(proxy.bytes_up() + proxy.bytes_down());
    thread.stop();
  }
  link.stop();
  Explored explored;
  std::vector<double> errors;
  for (std::size_t k = 0; k < device.felt.size(); k += place.every) {
    const auto& felt = device.felt[k];
    const auto exact = place.exact(felt.position_m);
    const client::Vector3 exact_n = client::Vector3::Map(exact.force_n.data());
    errors.push_back((felt.force_n - exact_n).norm() / (place.share * exact_n.norm() + place.floor_n));
    explored.share_in_tolerance += errors.back() <= 1;
  }
  explored.share_in_tolerance /= double(std::max<std::size_t>(errors.size(), 1));
  explored.p95 = client::percentile(errors, 0.95);
  explored.by_law_share = ticks.by_law_share();
  explored.lost_s = ticks.lost_s(), explored.faded_s = ticks.faded().seconds();
  explored.degraded_s = ticks.degraded().seconds();
  const auto stats = link.stats();
  explored.answers_per_s = double(stats.answers) / std::max(stats.last_answer_s - stats.first_answer_s, 0.1);
  explored.bytes_per_s = bytes / 8;
  std::printf(
      "%-5s %-12s %3.0f ms: right at %.1f %% of %zu ticks, p95 %.2f; by law %.1f %%; lost %.3f faded %.3f "
      "DEGRADED %.3f s; %.0f answers/s, %.1f kB/s; pieces %lu\n",
      place.scene_id.c_str(), renderer.c_str(), 1e3 * round_trip_s, 100 * explored.share_in_tolerance,
      errors.size(), explored.p95, 100 * explored.by_law_share, explored.lost_s, explored.faded_s,
      explored.degraded_s, explored.answers_per_s, 1e-3 * explored.bytes_per_s,
      (unsigned long)stats.law_pieces);
  return explored;
}

// Within 0.5 % + 1 mN of the plane's force.
Place in_plane() {
  service::SceneGeometry geometry;
  geometry.width_m = kWidthM, geometry.depth_m = kDepthM;
  const auto layer =
      service::tissue_models()->of_modulus(geometry, tissue(), {})->layer(service::Layer{}, {}, {});
  return {"s", 0.03, 0.09, 0.02, 0.005, 1e-3, 5, [layer](const auto& at) { return layer->answer({}, {at}); }};
}

// Within 2 % + 2 mN of the converged force on the whole block, its layered part exact.
Place on_solid() {
  const v1::CreateSceneRequest request = service::solid_scene("solid", 10, 12, ball_pa);
  service::ExplicitModulus modulus;
  const v1::ModulusMap& map = request.modulus();
  modulus.x_m.assign(map.x_m().begin(), map.x_m().end());
  modulus.y_m.assign(map.y_m().begin(), map.y_m().end());
  modulus.z_m.assign(map.z_m().begin(), map.z_m().end());
  const auto middle = [](const std::vector<double>& nodes, std::size_t n) {
    return (nodes[n] + nodes[n + 1]) / 2;
  };
  for (std::size_t k = 0; k + 1 < modulus.z_m.size(); ++k)
    for (std::size_t j = 0; j + 1 < modulus.y_m.size(); ++j)
      for (std::size_t i = 0; i + 1 < modulus.x_m.size(); ++i)
        modulus.youngs_modulus_pa.push_back(
            ball_pa(middle(modulus.x_m, i), middle(modulus.y_m, j), middle(modulus.z_m, k)));
  service::SceneGeometry geometry;
  geometry.width_m = request.geometry().size_m(0), geometry.depth_m = request.geometry().size_m(1);
  const service::SolidBlock block = service::solid_block(geometry, modulus);
  const auto device = service::Device::open();
  auto contact = std::make_shared<service::SolidContact<float>>(device->queue(), block.tissue);
  return {"solid", 0.006, 0.034, 0.007, 0.02, 2e-3, 40, [=](const service::Vector3& at) {
            const service::Vector3 pose{at[0] - block.origin_x_m, at[1], at[2] - block.origin_z_m};
            contact->touch({}, pose);
            return contact->felt_answer({}, pose);
          }};
}

TEST_F(FarLink, TheLawIsFeltWhereTheFingerIs) {
  const Place place = in_plane();
  for (const double round_trip_s : {0.0, 0.1, 0.2}) {
    const Explored law = explore(place, "law", round_trip_s);
    EXPECT_GE(law.share_in_tolerance, 0.95) << round_trip_s;
    EXPECT_GE(law.by_law_share, 0.95) << round_trip_s;
    EXPECT_EQ(law.lost_s, 0) << round_trip_s;
    EXPECT_EQ(law.faded_s, 0) << round_trip_s;
    EXPECT_EQ(law.degraded_s, 0) << round_trip_s;
  }
}

// Its law is sampled, and corrected, while the first hand sweeps.
TEST_F(FarLink, ASolidsLawIsFeltWhereTheFingerIs) {
  const Place place = on_solid();
  explore(place, "law", 0);
  for (const double round_trip_s : {0.1, 0.2}) {
    const Explored law = explore(place, "law", round_trip_s);
    EXPECT_GE(law.share_in_tolerance, 0.95) << round_trip_s;
    EXPECT_GE(law.by_law_share, 0.95) << round_trip_s;
    EXPECT_EQ(law.lost_s, 0) << round_trip_s;
    EXPECT_EQ(law.faded_s, 0) << round_trip_s;
  }
}

// The tests above can fail.
TEST_F(FarLink, AnswersAloneAreFeltLate) {
  EXPECT_LT(explore(in_plane(), "kalman", 0.1).share_in_tolerance, 0.7);
  EXPECT_LT(explore(on_solid(), "kalman", 0.1).share_in_tolerance, 0.7);
}

}  // namespace
}  // namespace teletact
