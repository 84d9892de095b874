// The batch script as Slurm would run it: a service on all addresses, its address told, drained by the
// signal.
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "client/link/channel.h"
#include "teletact/v1/info.grpc.pb.h"
#include "tests/integration/process.h"
#include "tests/packaging/packaged_file.h"
#include "tests/support/certificates.h"

namespace teletact {
namespace {

// A port that nobody has just now.
unsigned free_port() {
  const int socket = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  socklen_t size = sizeof address;
  const bool bound = ::bind(socket, reinterpret_cast<sockaddr*>(&address), size) == 0 &&
                     ::getsockname(socket, reinterpret_cast<sockaddr*>(&address), &size) == 0;
  ::close(socket);
  return bound ? ntohs(address.sin_port) : 0;
}

class Slurm : public testing::Test {
 protected:
  void SetUp() override {
    std::ofstream(folder_ / "cert.pem") << test::kCertificate;
    std::ofstream(folder_ / "key.pem") << test::kCertificateKey;
  }
  test::Environment environment() const {
    return {{"PATH", test::required_environment("TELETACT_BINARY_DIR") + "/service:" + std::getenv("PATH")},
            {"SLURM_JOB_ID", "7"},
            {"SLURM_SUBMIT_DIR", folder_ / ""},
            {"TELETACT_CERTIFICATE", folder_ / "cert.pem"},
            {"TELETACT_STATE", folder_ / "state"},
            {"TELETACT_PORT", std::to_string(port_)}};
  }
  const std::vector<std::string> script_{"/bin/bash", test::packaged_path("slurm/teletact.sbatch")};
  const test::TemporaryFolder folder_;
  const unsigned port_ = free_port();
};

TEST_F(Slurm, TheJobServesTellsItsAddressAndEndsBySignal) {
  test::Environment with_key = environment();
  with_key.emplace_back("TELETACT_KEY", folder_ / "key.pem");
  test::Process job(script_, folder_ / "log", with_key);
  ASSERT_TRUE(job.says("serving on", 300)) << job.output();
  const std::string address_file = folder_ / "teletact-7.address";
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  std::string address;
  while (address.empty() && std::chrono::steady_clock::now() < until)
    std::getline(std::ifstream(address_file), address);
  EXPECT_EQ(address.substr(address.rfind(':') + 1), std::to_string(port_)) << job.output();
  EXPECT_GT(address.rfind(':'), 0U) << "a host";
  const auto channel =
      client::make_channel("localhost:" + std::to_string(port_), {.tls_ca = test::kCertificate});
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(30));
  v1::GetInfoResponse info;
  EXPECT_TRUE(v1::Info::NewStub(channel)->GetInfo(&context, {}, &info).ok());
  EXPECT_TRUE(std::filesystem::exists(folder_ / "state"));
  job.kill(SIGTERM);
  EXPECT_EQ(job.wait(60), 0) << job.output();
  EXPECT_FALSE(std::filesystem::exists(address_file)) << "nobody serves there any more";
}

TEST_F(Slurm, WhatIsMissingIsNamedAndAFailureIsTheJobs) {
  const auto missing = test::run(script_, folder_ / "log", environment());
  EXPECT_NE(missing.code, 0);
  EXPECT_NE(missing.output.find("TELETACT_KEY"), std::string::npos) << missing.output;
  test::Environment foreign = environment();
  foreign.emplace_back("TELETACT_KEY", folder_ / "none.pem");
  const auto failed = test::run(script_, folder_ / "log", foreign, 300);
  EXPECT_EQ(failed.code, 1) << failed.output;
  EXPECT_NE(failed.output.find("none.pem"), std::string::npos) << failed.output;
}

}  // namespace
}  // namespace teletact
