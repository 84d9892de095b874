// The service as a process: the lines of its log say what belongs together.
#include <gtest/gtest.h>

#include <csignal>
#include <sstream>
#include <string>

#include "client/link/channel.h"
#include "teletact/v1/palpation.grpc.pb.h"
#include "tests/integration/process.h"
#include "tests/rpc/running_server.h"

namespace teletact {
namespace {

const std::string kTrace = "4bf92f3577b34da6a3ce929d0e0e4736";

bool create(const std::string& address, const std::string& scene_id) {
  grpc::ClientContext context;
  context.AddMetadata("traceparent", "00-" + kTrace + "-00f067aa0ba902b7-01");
  v1::Scene scene;
  return v1::Palpation::NewStub(client::make_channel(address))
      ->CreateScene(&context, service::uniform_scene(scene_id), &scene)
      .ok();
}

// The scene is made by one thread and kept by another.
TEST(Traces, LinesOfTheLogOfACallHaveItsTrace) {
  const test::TemporaryFolder folder;
  const std::string address = "unix:" + (folder / "s");
  test::Process service({test::service_binary(), "serve", "--listen", address, "--state", folder / "state"},
                        folder / "log");
  ASSERT_TRUE(service.says("serving on", 300)) << service.output();
  ASSERT_TRUE(create(address, "s"));
  EXPECT_TRUE(service.says("event=scene_created scene=s", 60));
  service.kill(SIGTERM);
  EXPECT_EQ(service.wait(60), 0) << service.output();
  std::istringstream log(service.output());
  std::size_t lines = 0;
  for (std::string line; std::getline(log, line);) {
    const bool of_the_call = line.find("scene=s ") != std::string::npos;
    lines += of_the_call;
    EXPECT_EQ(line.ends_with(" trace=" + kTrace), of_the_call) << line;
  }
  EXPECT_GT(lines, 0U) << service.output();
}

}  // namespace
}  // namespace teletact
