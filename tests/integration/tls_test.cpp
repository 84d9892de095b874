// Encryption end to end: the service with --tls-certificate and --tls-key, its clients with --tls-ca.
#include <gtest/gtest.h>

#include <algorithm>

#include "client/link/channel.h"
#include "teletact/v1/info.grpc.pb.h"
#include "tests/integration/process.h"
#include "tests/support/certificates.h"

namespace teletact {
namespace {

void write(const std::string& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

// The address in "... serving on ADDR, device ...".
std::string address_in(const std::string& output) {
  const std::string before = "serving on ";
  const std::size_t begin = output.find(before) + before.size();
  return output.substr(begin, output.find(',', begin) - begin);
}

bool answers(const std::string& address, const std::string& tls_ca) {
  const auto channel = client::make_channel(address, {.tls_ca = tls_ca});
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(5));
  v1::GetInfoResponse info;
  return v1::Info::NewStub(channel)->GetInfo(&context, {}, &info).ok();
}

TEST(Tls, OnlyClientsThatTrustTheCertificateAreServed) {
  test::TemporaryFolder folder;
  write(folder / "cert.pem", test::kCertificate);
  write(folder / "key.pem", test::kCertificateKey);
  write(folder / "foreign.pem", test::kForeignCertificate);
  test::Process service({test::service_binary(), "serve", "--listen", "127.0.0.1:0", "--tls-certificate",
                         folder / "cert.pem", "--tls-key", folder / "key.pem"},
                        folder / "service.log");
  ASSERT_TRUE(service.says("serving on", 300)) << service.output();
  const std::string address = address_in(service.output());
  EXPECT_TRUE(answers(address, test::kCertificate));
  EXPECT_FALSE(answers(address, test::kForeignCertificate));
  EXPECT_FALSE(answers(address, ""));

  const auto touch = [&](std::vector<std::string> more) {
    std::vector<std::string> command{test::client_binary(), "touch", "--service", address, "--scene", "none"};
    command.insert(command.end(), more.begin(), more.end());
    return test::run(command, folder / "client.log");
  };
  // What is not let in waits for a service: beside the others.
  const std::string foreign = folder / "foreign.pem";
  const std::vector<std::string> nobody{
      test::client_binary(), "touch", "--service", address, "--scene", "none"};
  test::Process plain(nobody, folder / "plain.log");
  auto words = nobody;
  words.insert(words.end(), {"--tls-ca", foreign});
  test::Process deceived(words, folder / "deceived.log");
  const auto expect_end = [](const test::Outcome& outcome, const char* word) {
    EXPECT_EQ(outcome.code, 1) << outcome.output;
    EXPECT_NE(outcome.output.find(word), std::string::npos) << outcome.output;
  };
  expect_end(touch({"--tls-ca", folder / "cert.pem"}), "scene_id: no scene");  // it was let in
  expect_end(touch({"--tls-ca", folder / "absent.pem"}), "absent.pem");
  expect_end(touch({"--tls-ca", folder / "key.pem"}), "no PEM certificate");
  for (test::Process* process : {&plain, &deceived}) {
    const int code = process->wait(60);
    expect_end({code, process->output()}, "--tls-ca");
  }
  EXPECT_TRUE(service.running());
}

TEST(Tls, FilesThatDoNotFitAreOneClearLine) {
  test::TemporaryFolder folder;
  write(folder / "cert.pem", test::kCertificate);
  write(folder / "foreign.pem", test::kForeignCertificate);
  write(folder / "key.pem", test::kCertificateKey);
  const auto serve = [&](const std::string& certificate, const std::string& key) {
    return test::run({test::service_binary(), "serve", "--listen", "127.0.0.1:0", "--tls-certificate",
                      certificate, "--tls-key", key},
                     folder / "log", {}, 300);
  };
  const auto refused = [](const test::Outcome& outcome, const char* word) {
    EXPECT_EQ(outcome.code, 1) << outcome.output;
    EXPECT_NE(outcome.output.find(word), std::string::npos) << outcome.output;
    EXPECT_EQ(std::count(outcome.output.begin(), outcome.output.end(), '\n'), 1) << outcome.output;
  };
  refused(serve(folder / "absent.pem", folder / "key.pem"), "--tls-certificate");
  refused(serve(folder / "cert.pem", folder / "absent.pem"), "--tls-key");
  refused(serve(folder / "foreign.pem", folder / "key.pem"), "TLS files do not fit");
}

}  // namespace
}  // namespace teletact
