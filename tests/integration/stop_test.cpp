// SIGTERM while the device's driver hangs: the process ends all the same.
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
  test::Process process({test::service_binary(), "serve", "--listen", address, "--kernel-directory",
                         folder / "kernels", "--state", folder / "state"},
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
  std::this_thread::sleep_for(std::chrono::seconds(1));
  process.kill(SIGTERM);
  EXPECT_EQ(process.wait(30), 0) << process.output();  // in 5 s; a machine may be busy
  EXPECT_NE(process.output().find("event=drain_cut"), std::string::npos) << process.output();
}

}  // namespace
}  // namespace teletact
