// Authority that is taken away, or ends, while calls run.
#include <fmt/chrono.h>

#include <ctime>
#include <future>
#include <thread>

#include "service/rpc/caller.h"
#include "tests/rpc/guarded_server.h"
#include "tests/support/finger_reader.h"

namespace teletact::service {
namespace {

using grpc::StatusCode;

const std::string kAdministrator = entry_of("root", "administrator");

class Revocation : public testing::TestWithParam<Transport> {
 protected:
  void SetUp() override {
    const Shown root = server.as("root");
    grpc::ClientContext context;
    root.on(context);
    v1::Scene scene;
    ASSERT_TRUE(v1::Palpation::NewStub(root.channel)->CreateScene(&context, uniform_scene("s"), &scene).ok());
  }
  static std::string entries(const std::string& more = "") {
    return kAdministrator + entry_of("hand", "operator", more) + entry_of("probe", "patient", more);
  }
  GuardedServer server{GetParam(), entries()};
};

// A touch that sends poses until the stream ends.
class Touching {
 public:
  explicit Touching(const Shown& who) : stub_(v1::Palpation::NewStub(who.channel)) {
    who.on(context_);
    stream_ = stub_->Touch(&context_);
    v1::TouchRequest request;
    *request.mutable_open() = Toucher::open_on("s");
    stream_->Write(request);
    v1::TouchResponse response;
    opened = stream_->Read(&response) && response.has_opened();
    steers = response.opened().steers();
  }
  // One answer more; false when it has ended.
  bool touch() {
    v1::TouchRequest request;
    v1::ContactPose* pose = request.mutable_pose();
    pose->set_sequence(++sequence_);
    pose->set_acknowledged(answered_);
    for (const double at_m : {0.05, 0.002}) pose->add_position_m(at_m);
    v1::TouchResponse response;
    if (!stream_->Write(request) || !stream_->Read(&response)) return false;
    answered_ = response.answer().answer();
    steers = response.answer().steers();
    return true;
  }
  grpc::Status until_it_ends() {
    while (touch()) std::this_thread::sleep_for(std::chrono::milliseconds(10));
    return stream_->Finish();
  }
  bool opened = false, steers = false;

 private:
  std::unique_ptr<v1::Palpation::Stub> stub_;
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::TouchRequest, v1::TouchResponse>> stream_;
  std::uint64_t sequence_ = 0, answered_ = 0;
};

// Three calls that run: a touch, a watcher, and an upload that does not go on. Each ends in its own thread.
class Running {
 public:
  Running(const Shown& hand, const Shown& probe)
      : touching_(hand),
        palpation_(v1::Palpation::NewStub(probe.channel)),
        elastography_(v1::Elastography::NewStub(probe.channel)) {
    probe.on(watch_context_);
    watching_ = std::make_unique<FingerReader>(*palpation_, watch_context_, "s");
    probe.on(estimate_context_);
    estimating_ = elastography_->Estimate(&estimate_context_);
    v1::EstimateRequest request;
    v1::Acquisition* a = request.mutable_acquisition();
    a->set_sample_count(1000), a->set_line_count(64);
    a->set_dtype(v1::DATA_TYPE_FLOAT32);
    a->set_center_frequency_hz(5e6), a->set_sampling_frequency_hz(40e6);
    a->set_sound_speed_m_s(1540), a->set_line_pitch_m(0.0003);
    a->set_displacement_frame(v1::DISPLACEMENT_FRAME_PROBE);
    estimating_->Write(request);
    v1::FingerState state;
    EXPECT_TRUE(touching_.opened && touching_.touch());
    EXPECT_TRUE(watching_->read(&state));
  }
  // Of touch, watch and estimate, once all have ended.
  std::vector<grpc::Status> until_they_end() {
    auto touched = std::async(std::launch::async, [this] { return touching_.until_it_ends(); });
    auto watched = std::async(std::launch::async, [this] { return watching_->finish(); });
    v1::EstimateResponse response;
    while (estimating_->Read(&response)) {
    }
    return {touched.get(), watched.get(), estimating_->Finish()};
  }
  bool goes_on() { return touching_.touch(); }

 private:
  Touching touching_;
  std::unique_ptr<v1::Palpation::Stub> palpation_;
  std::unique_ptr<v1::Elastography::Stub> elastography_;
  grpc::ClientContext watch_context_, estimate_context_;
  std::unique_ptr<FingerReader> watching_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::EstimateRequest, v1::EstimateResponse>> estimating_;
};

TEST_P(Revocation, CallsOfAnEntryThatIsTakenOutEnd) {
  Running running(server.as("hand"), server.as("probe"));
  server.put_entries(kAdministrator);
  for (const grpc::Status& status : running.until_they_end())
    EXPECT_EQ(status.error_code(), StatusCode::UNAUTHENTICATED) << status.error_message();
  EXPECT_EQ(Touching(server.as("hand")).opened, false);
}

TEST_P(Revocation, CallsOfAnEntryThatExpiresEnd) {
  const std::time_t soon = WallClock::to_time_t(WallClock::now() + std::chrono::hours(1));
  server.put_entries(entries(fmt::format("expires = {:%Y-%m-%dT%H:%M:%SZ}\n", fmt::gmtime(soon))));
  const std::uint64_t first = server->core().access->version();
  while (server->core().access->version() == first)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  Running running(server.as("hand"), server.as("probe"));
  EXPECT_TRUE(running.goes_on());
  server.let_pass(std::chrono::hours(2));
  for (const grpc::Status& status : running.until_they_end())
    expect_refused(status, StatusCode::UNAUTHENTICATED, "expired at ");
}

TEST_P(Revocation, CallsThatTheNewRoleDoesNotAllowEnd) {
  Running running(server.as("hand"), server.as("probe"));
  server.put_entries(kAdministrator + entry_of("hand", "observer") + entry_of("probe", "observer"));
  for (const grpc::Status& status : running.until_they_end())
    expect_refused(status, StatusCode::PERMISSION_DENIED, "may not");
  // The next one does what is left to it.
  const Touching again(server.as("hand"));
  EXPECT_TRUE(again.opened);
  EXPECT_FALSE(again.steers);
}

TEST_P(Revocation, CallsOfOthersGoOn) {
  Running running(server.as("hand"), server.as("probe"));
  Touching other(server.as("root"));
  ASSERT_TRUE(other.opened && other.touch());
  EXPECT_FALSE(other.steers) << "the hand does";
  server.put_entries(kAdministrator);
  running.until_they_end();
  // The lease is free, and passes on.
  while (!other.steers) ASSERT_TRUE(other.touch());
}

// A file that is being written, or is wrong, ends nothing.
TEST_P(Revocation, AFileThatCannotBeReadEndsNothing) {
  Running running(server.as("hand"), server.as("probe"));
  server.put_entries("[[entry]]\nname = ");
  const auto& access = *server->core().access;
  const std::uint64_t looked = access.looks();
  while (access.looks() < looked + 3) ASSERT_TRUE(running.goes_on());
  EXPECT_TRUE(Touching(server.as("hand")).opened) << "asked anew";
  server.put_entries(kAdministrator);
  for (const grpc::Status& status : running.until_they_end())
    EXPECT_EQ(status.error_code(), StatusCode::UNAUTHENTICATED) << status.error_message();
}

INSTANTIATE_TEST_SUITE_P(Everywhere, Revocation, testing::Values(Transport::kSocket, Transport::kMutualTls),
                         [](const auto& info) {
                           return info.param == Transport::kSocket ? "ByToken" : "ByCertificate";
                         });

}  // namespace
}  // namespace teletact::service
