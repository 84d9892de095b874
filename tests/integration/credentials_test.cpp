// The trial set of packaging/teletact-credentials, end to end: what it makes lets each role in, by token and
// by certificate, over TLS, and nobody else.
#include <gtest/gtest.h>

#include <algorithm>
#include <utility>

#include "client/link/channel.h"
#include "tests/integration/process.h"

namespace teletact {
namespace {

class TrialSet : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    shared = new test::TemporaryFolder;
    const test::Outcome made =
        test::run({script(), "--out", *shared / "set", "--host", "localhost"}, *shared / "log");
    ASSERT_EQ(made.code, 0) << made.output;
    for (const char* words :
         {"teletact-service serve", "--access ", "teletact-client scenes", "--token-file "})
      EXPECT_NE(made.output.find(words), std::string::npos) << words << "\n" << made.output;
  }
  static void TearDownTestSuite() { delete std::exchange(shared, nullptr); }
  static std::string script() {
    return test::required_environment("TELETACT_SOURCE_DIR") + "/packaging/teletact-credentials";
  }
  std::unique_ptr<test::Process> serve(const std::vector<std::string>& more) {
    std::vector<std::string> command{test::service_binary(), "serve",    "--listen",
                                     "127.0.0.1:0",          "--access", set + "/access.toml"};
    command.insert(command.end(), more.begin(), more.end());
    return std::make_unique<test::Process>(command, folder / "service.log");
  }
  // The address in "... serving on ADDR, device ...".
  static std::string address_of(test::Process& service) {
    EXPECT_TRUE(service.says("serving on", 300)) << service.output();
    const std::string output = service.output(), before = "serving on ";
    const std::size_t begin = output.find(before) + before.size();
    return output.substr(begin, output.find(',', begin) - begin);
  }
  std::vector<std::string> tls() const {
    return {"--tls-certificate", set + "/server.pem", "--tls-key", set + "/server-key.pem"};
  }
  test::Outcome client(const std::string& command, const std::string& address,
                       const std::vector<std::string>& more) const {
    std::vector<std::string> words{test::client_binary(), command, "--service", address};
    words.insert(words.end(), more.begin(), more.end());
    return test::run(words, folder / "client.log");
  }
  std::vector<std::string> token(const std::string& role) const {
    return {"--token-file", set + "/" + role + ".token"};
  }
  static void expect_end(const test::Outcome& outcome, int code, const std::vector<std::string>& words) {
    EXPECT_EQ(outcome.code, code) << outcome.output;
    for (const std::string& word : words)
      EXPECT_NE(outcome.output.find(word), std::string::npos) << word << "\n" << outcome.output;
  }
  static std::vector<std::string> joined(std::vector<std::string> a, const std::vector<std::string>& b) {
    a.insert(a.end(), b.begin(), b.end());
    return a;
  }
  static inline test::TemporaryFolder* shared = nullptr;
  test::TemporaryFolder folder;
  const std::string set = *shared / "set";
};

TEST_F(TrialSet, TokensLetEachRoleInOverTls) {
  const auto service = serve(tls());
  const std::string address = address_of(*service);
  const auto with = [&](const std::string& role, const std::vector<std::string>& more = {}) {
    return joined(joined(token(role), {"--tls-ca", set + "/ca.pem"}), more);
  };
  for (const char* role : {"patient", "operator", "observer", "administrator"})
    expect_end(client("scenes", address, with(role)), 0, {"no scenes"});
  expect_end(client("scenes", address, with("operator", {"--delete", "s"})), 1,
             {"PERMISSION_DENIED", "operator", "administrator"});
  expect_end(client("scenes", address, with("administrator", {"--delete", "s"})), 1, {"NOT_FOUND"});
  expect_end(client("touch", address, with("patient", {"--scene", "s"})), 1, {"NOT_FOUND"});
  expect_end(client("slices", address, with("observer", {"--scene", "s"})), 1,
             {"PERMISSION_DENIED", "observer", "patient"});
  // Without a token, and with one that nobody was given: at once, and said what to give.
  for (const char* command : {"scenes", "touch"}) {
    std::vector<std::string> more{"--tls-ca", set + "/ca.pem"};
    if (std::string(command) == "touch") more = joined(more, {"--scene", "s", "--wait-s", "600"});
    expect_end(client(command, address, more), 1, {"UNAUTHENTICATED", "--token-file"});
    std::ofstream(folder / "wrong.token") << "nobodys\n";
    expect_end(client(command, address, joined(more, {"--token-file", folder / "wrong.token"})), 1,
               {"UNAUTHENTICATED", "not known"});
  }
  EXPECT_TRUE(service->running());
  EXPECT_EQ(service->output().find("nobodys"), std::string::npos) << "a token in the log";
}

TEST_F(TrialSet, CertificatesLetEachRoleInOverMutualTls) {
  const auto service = serve(joined(tls(), {"--tls-client-ca", set + "/ca.pem"}));
  const std::string address = address_of(*service);
  const std::vector<std::string> ca{"--tls-ca", set + "/ca.pem"};
  for (const std::string role : {"patient", "operator", "observer", "administrator"})
    expect_end(client("scenes", address,
                      joined(ca, {"--tls-certificate", set + "/" + role + ".pem", "--tls-key",
                                  set + "/" + role + "-key.pem"})),
               0, {"no scenes"});
  // Without one, and by the service's own: it is none of a client, though the same authority signed it. Both
  // are waited for at once.
  const std::vector<std::string> without =
      joined({test::client_binary(), "scenes", "--service", address}, ca);
  test::Process nameless(without, folder / "nameless.log");
  test::Process server(
      joined(without, {"--tls-certificate", set + "/server.pem", "--tls-key", set + "/server-key.pem"}),
      folder / "server.log");
  for (auto& [process, word] :
       {std::pair(&nameless, "--tls-certificate"), std::pair(&server, "no service at")}) {
    const int code = process->wait(60);
    expect_end({code, process->output()}, 1, {word});
  }
}

TEST_F(TrialSet, TokensAloneWillDoOnThisMachine) {
  const auto service = serve({});
  const std::string address = address_of(*service);
  expect_end(client("scenes", address, token("observer")), 0, {"no scenes"});
  expect_end(client("scenes", address, {}), 1, {"UNAUTHENTICATED", "--token-file"});
  expect_end(client("scenes", "node7:50051", token("observer")), 1, {"--tls-ca", "could read the token"});
}

TEST_F(TrialSet, IsNotWrittenOverAndAccessThatIsWrongIsOneClearLine) {
  expect_end(test::run({script(), "--out", set}, folder / "log"), 1, {"--out", "new one"});
  const auto refused = [&](const std::vector<std::string>& more, const char* word,
                           const std::string& listen = "127.0.0.1:0") {
    const std::vector<std::string> command{test::service_binary(), "serve", "--listen", listen};
    const test::Outcome outcome = test::run(joined(command, more), folder / "log", {}, 300);
    expect_end(outcome, 1, {word});
    EXPECT_EQ(std::count(outcome.output.begin(), outcome.output.end(), '\n'), 1) << outcome.output;
  };
  refused({"--access", folder / "absent.toml"}, "--access");
  std::ofstream(folder / "access.toml") << "[[entry]]\nname = \"anna\"\n";
  refused({"--access", folder / "access.toml"}, "anna");
  refused({"--tls-client-ca", set + "/ca.pem"}, "--tls-client-ca");
  refused({"--allow-insecure-remote", "--access", set + "/access.toml"}, "--tls-certificate", "0.0.0.0:0");
}

}  // namespace
}  // namespace teletact
