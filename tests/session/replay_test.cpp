// Recordings that are played again through a service.
#include "client/session/replay.h"

#include <gtest/gtest.h>

#include <optional>

#include "client/session/operator_session.h"
#include "tests/files/temporary_folder.h"
#include "tests/link/fake_palpation.h"
#include "tests/session/session_options.h"
#include "tests/support/fake_service.h"

namespace teletact::client {
namespace {

TEST(Replay, FindsTheRecordedForcesAgainAndSeesAChange) {
  const TemporaryFolder folder;
  test::FakePalpation service(test::socket_address("replay"));
  service.serve();
  OperatorSessionOptions options = test::session_options(test::socket_address("replay"));
  options.duration_s = 0.6;
  options.record_path = folder / "touch";
  const std::atomic<bool> stop{false};
  const TouchSummary summary = run_operator_session(options, stop);
  ReplayOptions replay_options;
  replay_options.path = options.record_path;
  replay_options.address = options.address;
  replay_options.speed = 0;
  const ReplayReport same = replay(replay_options, stop);
  EXPECT_EQ(same.kind, "touch");
  EXPECT_GE(same.compared + 2, summary.link.answers);
  EXPECT_GT(same.compared, 50u);
  EXPECT_EQ(same.not_alike, 0u);
  EXPECT_LE(same.largest_force_difference_n, 1e-12);
  service.harden(1.5);
  const ReplayReport other = replay(replay_options, stop);
  EXPECT_GT(other.largest_force_difference_n, 0.1);
}

class AcquisitionReplay : public testing::Test {
 protected:
  AcquisitionReplay() {
    service.create_scene("s");
    v1::RecordHeader header;
    header.set_kind("acquire");
    header.set_scene_id("s");
    writer.emplace(folder / "pair", header);
    request.mutable_acquisition()->add_maps("youngs_modulus");
    writer->append_waiting(recorded(request, 1, 1));
  }
  // What was written, ended by its summary.
  ReplayReport played() {
    v1::EstimateResponse response;
    response.mutable_summary();
    writer->append_waiting(recorded(response, 3, 1));
    writer->close();
    ReplayOptions options;
    options.path = folder / "pair";
    options.address = service.address();
    options.speed = 0;
    return replay(options, false);
  }
  teletact::test::FakeServer service;
  const TemporaryFolder folder;
  v1::EstimateRequest request;
  std::optional<RecordWriter> writer;
};

// What a page shows of an acquisition is kept without its frames, too.
TEST_F(AcquisitionReplay, WithoutItsFramesHoldsNothingToPlay) {
  try {
    played();
    ADD_FAILURE();
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("holds nothing to play"), std::string::npos) << error.what();
  }
}

// GIVEN a pair of which two maps came WHEN the service sends one of them this time
TEST_F(AcquisitionReplay, MapsThatDoNotComeAreNotAlike) {
  request.mutable_chunk();
  writer->append_waiting(recorded(request, 1, 1));
  for (const char* name : {"youngs_modulus", "axial_strain"}) {
    v1::EstimateResponse response;
    response.mutable_map()->mutable_map()->set_name(name);
    writer->append_waiting(recorded(response, 2, 1));
  }
  const ReplayReport report = played();
  EXPECT_EQ(report.compared, 1u);
  EXPECT_EQ(report.not_alike, 2u) << "one of another size, and one that did not come";
}

TEST(Replay, SaysHowManyAnswersAreNotAsTheyWere) {
  ReplayReport report;
  report.kind = "touch";
  report.compared = 7;
  EXPECT_EQ(what_is_not_alike(report), "");
  report.not_alike = 2;
  EXPECT_EQ(what_is_not_alike(report).find("2 of 7 answers"), 0u) << what_is_not_alike(report);
}

}  // namespace
}  // namespace teletact::client
