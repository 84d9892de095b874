#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <string>

#include "client/link/recording.h"
#include "client/servo/states.h"
#include "tests/commands/fake_service.h"

namespace teletact::client {
namespace {

// A gnuplot that draws nothing: pictures are not what is looked at, and it may be absent.
class NoGnuplot {
 public:
  NoGnuplot() {
    put_content(folder_ / "gnuplot", "#!/bin/sh\n");
    std::filesystem::permissions(folder_ / "gnuplot", std::filesystem::perms::owner_all);
    setenv("PATH", ((folder_ / "").string() + ":" + before_).c_str(), 1);
  }
  ~NoGnuplot() { setenv("PATH", before_.c_str(), 1); }
  NoGnuplot(const NoGnuplot&) = delete;
  NoGnuplot& operator=(const NoGnuplot&) = delete;

 private:
  const TemporaryFolder folder_;
  const std::string before_ = std::getenv("PATH");
};

// One second with force on, answered five times; for 0.1 s of it the hand is held at the border of the
// tissue.
void record_stall(const std::string& path) {
  v1::RecordHeader header;
  header.set_kind("touch");
  RecordWriter writer(path, header);
  for (int ms = 0; ms <= 1000; ++ms) {
    v1::RecordEntry entry;
    entry.set_monotonic_ns(1'000'000LL * (1000 + ms));
    v1::ServoSample& tick = *entry.mutable_servo();
    for (const double at : {0.05, 0.003, 0.0}) tick.add_position_m(at), tick.add_force_n(0);
    tick.set_state(static_cast<std::uint32_t>(ServoState::kEnabled));
    tick.set_at_border(ms >= 500 && ms < 600);
    writer.append_waiting(entry);
    if (ms % 200 > 0) continue;
    v1::TouchResponse response;
    for (const double at : {0.05 + 1e-6 * ms, 0.003, 0.0}) response.mutable_answer()->add_position_m(at);
    response.mutable_answer()->mutable_pose_stamp()->set_monotonic_ns(entry.monotonic_ns() - 2'000'000);
    writer.append_waiting(recorded(response, entry.monotonic_ns(), 1));
  }
  writer.close();
}

TEST(ReportCommand, MissedPromiseEndsWithTwo) {
  const TemporaryFolder folder;
  const NoGnuplot gnuplot;
  record_stall((folder / "touch").string());
  try {
    test::run_command(
        {"report", "--touch-record", (folder / "touch").string(), "--out", (folder / "out").string()});
    FAIL() << "no stalls are promised";
  } catch (const CLI::RuntimeError& missed) {
    EXPECT_EQ(missed.get_exit_code(), 2);
  }
  EXPECT_TRUE(std::filesystem::exists(folder / "out" / "summary.json"));
}

}  // namespace
}  // namespace teletact::client
