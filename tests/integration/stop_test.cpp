// A signal while kernels are compiled, the device's driver hangs, or a hand does not move: the process ends
// all the same.
#include <grpcpp/create_channel.h>
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "tests/integration/process.h"
#include "tests/rpc/estimate_client.h"

namespace teletact {
namespace {

namespace fs = std::filesystem;

// A copy of the kernels whose search never ends where a large strain is asked for.
void make_hanging_kernels(const std::string& folder) {
  fs::copy(test::source_kernels(), folder, fs::copy_options::recursive);
  const std::string file = folder + "/search.cl", from = "  float energy = 0.0f;\n";
  std::stringstream text;
  text << std::ifstream(file).rdbuf();
  std::string source = text.str();
  const auto at = source.find(from);
  ASSERT_NE(at, std::string::npos);
  source.insert(at, "  volatile int hangs = lags.reach_slope > 0.15f;\n  while (hangs) {\n  }\n");
  std::ofstream(file) << source;
}

TEST(Stop, DriverThatHangsDoesNotHoldTheProcess) {
  test::TemporaryFolder folder;
  make_hanging_kernels(folder / "kernels");
  const std::string address = "unix:" + (folder / "s");
  std::ofstream(folder / "config.toml") << "[limits]\ndrain_s = 0.3\n";
  test::Process process({test::service_binary(), "serve", "--listen", address, "--kernel-directory",
                         folder / "kernels", "--state", folder / "state", "--config", folder / "config.toml"},
                        folder / "log");
  ASSERT_TRUE(process.says("serving on", 120)) << process.output();
  service::Elastographer call(grpc::CreateChannel(address, grpc::InsecureChannelCredentials()));
  service::v1::Acquisition a = service::acquisition();
  a.set_max_strain(0.12);
  call.send(a);
  call.send_frame(service::v1::FRAME_KIND_PRE, service::pair().pre);
  call.send_frame(service::v1::FRAME_KIND_POST, service::pair().post);
  call.close();
  service::v1::EstimateResponse response;
  ASSERT_TRUE(call.read(&response));
  EXPECT_EQ(response.progress().stage(), service::v1::ESTIMATE_STAGE_RECEIVED);
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  process.kill(SIGTERM);
  EXPECT_EQ(process.wait(60), 0) << process.output();
  EXPECT_NE(process.output().find("event=drain_cut"), std::string::npos) << process.output();
}

// Where nothing is compiled yet that takes 20 s, and minutes on a busy machine.
TEST(Stop, AStartThatCompilesSaysHowFarItIsAndEndsAtOnce) {
  test::TemporaryFolder folder;
  test::Process process({test::service_binary(), "serve", "--listen", "unix:" + (folder / "s")},
                        folder / "log", {{"POCL_CACHE_DIR", folder / "cache"}});
  ASSERT_TRUE(process.says("event=compiling step=", 120)) << process.output();
  EXPECT_EQ(process.output().find("serving on"), std::string::npos) << process.output();
  process.kill(SIGTERM);
  EXPECT_EQ(process.wait(60), 0) << process.output();
  EXPECT_NE(process.output().find("event=stopped_while_starting"), std::string::npos) << process.output();
}

// Whatever a demo waits for: here for a service, and a patient side, that take their time.
TEST(Stop, CtrlCEndsADemoWithOneLine) {
  for (const std::string serves : {"", "serving on nothing\n"})
    for (const std::string which : {"", "--plane", "--page", "--solid-given"}) {
      test::TemporaryFolder folder;
      for (const char* binary :
           {"service/teletact-service", "client/teletact-client", "bench/teletact-proxy"}) {
        const fs::path path = folder / binary;
        fs::create_directories(path.parent_path());
        std::ofstream(path) << "#!/bin/sh\nprintf 'log of it\\n"
                            << (serves.empty() ? "" : "serving on nothing\\n")
                            << "the page is at nothing\\n'\nexec sleep 60\n";
        fs::permissions(path, fs::perms::owner_all);
      }
      const std::string script =
          "set -euo pipefail; BUILD=$1; say() { printf '== %s\\n' \"$*\" >&2; }; die() { exit 9; }; build() "
          "{ :; }; "
          "choose_kernel_cache() { :; }; source \"$2\"; shift 2; demo --out \"$BUILD/out\" \"$@\"";
      std::vector<std::string> words{
          "/bin/bash", "-c",        script,
          "bash",      folder / "", test::required_environment("TELETACT_SOURCE_DIR") + "/demo/demo.bash"};
      if (!which.empty()) words.push_back(which);
      test::Process process(words, folder / "log");
      ASSERT_TRUE(process.says(serves.empty() ? "the page is at nothing" : "2/4", 30)) << process.output();
      process.kill(SIGINT);
      EXPECT_EQ(process.wait(30), 130) << which;
      const std::string output = process.output(),
                        last = output.substr(output.rfind('\n', output.size() - 2) + 1);
      EXPECT_EQ(last, "teletact: interrupted\n") << output;
      EXPECT_EQ(output.find("the end of"), std::string::npos) << output;
    }
}

// Who sends the signal twice does not wait for hands to move.
TEST(Stop, SecondSignalEndsTheTimeInWhichHandsMove) {
  test::TemporaryFolder folder;
  const std::string address = "unix:" + (folder / "s");
  std::ofstream(folder / "config.toml") << "[limits]\nmove_s = 300\n";
  test::Process process({test::service_binary(), "serve", "--listen", address, "--state", folder / "state",
                         "--standby", "--config", folder / "config.toml"},
                        folder / "log");
  ASSERT_TRUE(process.says("serving on", 120)) << process.output();
  const auto channel = grpc::CreateChannel(address, grpc::InsecureChannelCredentials());
  grpc::ClientContext context;
  service::v1::Scene scene;
  ASSERT_TRUE(service::v1::Palpation::NewStub(channel)
                  ->CreateScene(&context, service::uniform_scene("s"), &scene)
                  .ok());
  service::Toucher hand(channel, "s");
  service::v1::TouchAnswer answer;
  ASSERT_TRUE(hand.opened() && hand.touch(0.05, 0.002, &answer));
  EXPECT_FALSE(answer.moving());
  process.kill(SIGTERM);
  ASSERT_TRUE(process.says("event=move touches=1", 60)) << process.output();
  ASSERT_TRUE(hand.touch(0.05, 0.002, &answer));
  EXPECT_TRUE(answer.moving());
  process.kill(SIGTERM);
  EXPECT_EQ(process.wait(60), 0) << process.output();
  EXPECT_NE(process.output().find("event=drained"), std::string::npos) << process.output();
  EXPECT_EQ(hand.finish().error_code(), grpc::StatusCode::UNAVAILABLE);
}

// A terminal that is closed ends it in order, unless it was to go on without one.
TEST(Stop, AClosedTerminalDrainsItUnlessNohupSaysNot) {
  for (const bool nohup : {false, true}) {
    test::TemporaryFolder folder;
    test::Process process(
        {"/bin/sh", "-c",
         std::string(nohup ? "trap '' HUP; " : "") + "exec \"$0\" serve --listen \"unix:$1\"",
         test::service_binary(), folder / "s"},
        folder / "log");
    ASSERT_TRUE(process.says("serving on", 120)) << process.output();
    for (int times = 0; times < (nohup ? 100 : 1); ++times) process.kill(SIGHUP);
    if (nohup) process.kill(SIGTERM);
    EXPECT_EQ(process.wait(60), 0) << process.output();
    EXPECT_NE(process.output().find(nohup ? "event=signal signal=15" : "event=signal signal=1\n"),
              std::string::npos)
        << process.output();
    EXPECT_NE(process.output().find("event=drained"), std::string::npos) << process.output();
  }
}

}  // namespace
}  // namespace teletact
