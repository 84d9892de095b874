// Several devices: scenes of their own, one that fails or hangs beside one that goes on.
#include <array>
#include <cstring>
#include <future>
#include <map>

#include "service/device/device.h"
#include "service/rpc/estimate_messages.h"
#include "service/scene/errors.h"
#include "tests/rpc/estimate_client.h"
#include "tests/rpc/health.h"
#include "tests/rpc/two_devices.h"

namespace teletact::service {
namespace {

class TwoDevices : public testing::Test {
 protected:
  TwoDevices() {
    server->make_ready();
    for (const char* id : {"a", "b"}) {
      v1::CreateSceneRequest request;
      request.set_scene_id(id);
      for (const double size_m : {0.1, 0.02}) request.mutable_geometry()->add_size_m(size_m);
      EXPECT_TRUE(server.create(request).ok());
    }
  }
  ~TwoDevices() override { fail_launches(false); }
  grpc::Status image(const std::string& scene) {
    return estimate(server.channel(), acquisition(scene)).status;
  }
  ImagingPlane& plane() { return server->core().imaging; }
  // Images it, and returns on which device.
  std::size_t imaged_on(const std::string& scene) {
    const double before_s[] = {worked_s(0), worked_s(1)};
    EXPECT_TRUE(image(scene).ok());
    const double s[] = {worked_s(0) - before_s[0], worked_s(1) - before_s[1]};
    const std::size_t device = s[1] > s[0] ? 1 : 0;
    EXPECT_LT(s[1 - device], s[device] / 10);
    return device;
  }
  // Both scenes, by the device that images them.
  std::array<std::string, 2> placed() {
    std::array<std::string, 2> of;
    for (const char* id : {"a", "b"}) of[imaged_on(id)] = id;
    EXPECT_TRUE(!of[0].empty() && !of[1].empty()) << "each has one";
    return of;
  }
  // Once all that was begun and is owed has ended there.
  double worked_s(std::size_t number) {
    Workers& workers = plane().workers();
    JobTerms last;
    last.owed = true;
    last.device = number;
    workers.run(last, [] {}).future.get();
    return workers.worked_s(number);
  }
  v1::GetInfoResponse info() {
    grpc::ClientContext context;
    set_deadline(context);
    v1::GetInfoResponse info;
    EXPECT_TRUE(v1::Info::NewStub(server.channel())->GetInfo(&context, {}, &info).ok());
    return info;
  }
  RunningServer server{"", "", {}, tissue_models(), two_devices()};
};

TEST_F(TwoDevices, ImageScenesWithBudgetsOfTheirOwn) {
  placed();
  const v1::GetInfoResponse told = info();
  ASSERT_EQ(told.devices_size(), 2);
  EXPECT_EQ(told.device().name(), told.devices(0).name());
  std::map<std::string, std::uint64_t> held;
  for (const v1::MemoryUse& use : told.memory()) held[use.place()] += use.bytes();
  EXPECT_GT(held["device"], 0U) << "kept for the next pair";
  EXPECT_GT(held["device 1"], 0U);
  EXPECT_EQ(held["device"], server->core().memory->held(place_of_device(0)));
  EXPECT_EQ(held["device 1"], server->core().memory->held(place_of_device(1)));
}

TEST_F(TwoDevices, ScenesLeaveOneThatFails) {
  ASSERT_TRUE(server.create(uniform_scene("touched")).ok());
  const auto [first, second] = placed();
  Bystander touching(server.channel(), "touched");
  fail_launches(true, 0);
  expect_refused(image(first), grpc::StatusCode::UNAVAILABLE, "send the pair again");
  EXPECT_TRUE(image(second).ok());
  EXPECT_TRUE(image(first).ok()) << "by the other";
  EXPECT_EQ(plane().scenes_moved(), 1U);
  EXPECT_EQ(health_of(server, kElastography), kServing);
  fail_launches(true, 1);
  expect_refused(image(second), grpc::StatusCode::UNAVAILABLE, "send the pair again");
  while (health_of(server, kElastography) == kServing)  // soon: on a thread of its own
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  expect_refused(image(first), grpc::StatusCode::UNAVAILABLE, "reopened");
  fail_launches(false);
  while (!plane().lanes()[0].works() || !plane().lanes()[1].works())
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  EXPECT_EQ(imaged_on(first), 1U) << "it stays where it is";
  EXPECT_EQ(imaged_on(second), 1U);
  EXPECT_EQ(plane().scenes_moved(), 1U);
  touching.stop();
  EXPECT_EQ(touching.failures(), 0);
}

TEST_F(TwoDevices, ScenesLeaveOneThatHangs) {
  const auto [first, second] = placed();
  ImagingLane& hanging = plane().lanes()[0];
  std::promise<void> release;
  const auto hung = plane().workers().run({}, [&] { release.get_future().wait(); });
  Elastographer stuck(server.channel());
  upload(stuck, acquisition(first));
  EXPECT_TRUE(image(second).ok());
  hanging.hangs_after(0.05);
  while (hanging.works()) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  EXPECT_TRUE(image(first).ok()) << "by the other";
  EXPECT_EQ(plane().scenes_moved(), 1U);
  EXPECT_EQ(health_of(server, kElastography), kServing);
  const std::uint64_t version = server->core().scenes.find(first)->snapshot()->version;
  release.set_value();
  expect_refused(stuck.finish().status, grpc::StatusCode::UNAVAILABLE, "send the pair again");
  EXPECT_EQ(server->core().scenes.find(first)->snapshot()->version, version)
      << "what came meanwhile is newer";
}

// Its pair was about to be published when the device began to hang.
TEST_F(TwoDevices, ResumedOnePublishesNothingOverNewerWindows) {
  const auto [first, second] = placed();
  ImagingLane& hanging = plane().lanes()[0];
  const EstimateRequest request =
      request_from(acquisition(first), server->core().scenes, server->core().limits);
  const auto frame = [&](const std::string& bytes) {
    std::vector<float> samples(request.samples());
    std::memcpy(samples.data(), bytes.data(), bytes.size());
    return RfFrame{request.sample_count, request.line_count, samples};
  };
  JobTerms terms;
  terms.client = "anna";
  const auto frames = [&] { return std::pair(frame(pair().pre), frame(pair().post)); };
  std::promise<void> begun, release;
  auto hung = plane().workers().run({}, [&] {
    return hanging.estimate(request, terms, std::chrono::steady_clock::now(), frames, [&](Stage stage) {
      if (stage != Stage::kModulus) return;
      begun.set_value();
      release.get_future().wait();
    });
  });
  begun.get_future().wait();
  hanging.hangs_after(0.05);
  while (hanging.works()) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  EXPECT_TRUE(image(first).ok()) << "by the other";
  const std::uint64_t version = server->core().scenes.find(first)->snapshot()->version;
  release.set_value();
  try {
    hung.future.get();
    ADD_FAILURE() << "published over what is newer";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind, ErrorKind::kUnavailable);
  }
  EXPECT_EQ(server->core().scenes.find(first)->snapshot()->version, version);
}

TEST_F(TwoDevices, SceneDeletedWhileImagedLeavesNothing) {
  const auto [first, second] = placed();
  std::promise<void> release;
  JobTerms on_second;
  on_second.device = 1;
  plane().workers().run(on_second, [&] { release.get_future().wait(); });
  Elastographer call(server.channel());
  upload(call, acquisition(second));
  v1::EstimateResponse received;
  EXPECT_TRUE(call.read(&received));
  EXPECT_TRUE(server.remove(second).ok());
  release.set_value();
  expect_refused(call.finish().status, grpc::StatusCode::ABORTED, second + " was deleted");
  EXPECT_TRUE(image(first).ok());
}

// Where a scene was imaged is not kept: other devices go on with it.
TEST(Devices, ScenesOutliveThemOnOthers) {
  char state[] = "/tmp/teletact-devices-XXXXXX";
  ASSERT_NE(mkdtemp(state), nullptr);
  std::uint64_t version = 0;
  for (const auto& devices : {two_devices(), {}, two_devices()}) {
    RunningServer server("", state, {}, tissue_models(), devices);
    server->make_ready();
    for (const char* id : {"a", "b"}) {
      if (version == 0) {
        v1::CreateSceneRequest request;
        request.set_scene_id(id);
        for (const double size_m : {0.1, 0.02}) request.mutable_geometry()->add_size_m(size_m);
        ASSERT_TRUE(server.create(request).ok());
      }
      const auto scene = server->core().scenes.find(id);
      EXPECT_EQ(scene->snapshot()->windows.size(), version == 0 ? 0U : 1U);
      const Outcome outcome = estimate(server.channel(), acquisition(id));
      EXPECT_TRUE(outcome.status.ok()) << outcome.status.error_message();
    }
    ++version;
  }
  std::filesystem::remove_all(state);
}

}  // namespace
}  // namespace teletact::service
