// What a person's environment and command line may hold that has nothing to do with what is asked: proxies,
// names that are no text, a folder that another run writes.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <string>
#include <vector>

#include "client/files/file_io.h"
#include "client/link/channel.h"
#include "tests/commands/fake_service.h"

namespace teletact::client {
namespace {

// A proxy that is not there, named by `variable` while this lives.
class DeadProxy {
 public:
  explicit DeadProxy(const char* variable) : variable_(variable) {
    ::setenv(variable_, "http://127.0.0.1:9", 1);
    ::setenv("no_proxy", "localhost", 1);
  }
  ~DeadProxy() {
    ::unsetenv(variable_);
    ::unsetenv("no_proxy");
  }
  DeadProxy(const DeadProxy&) = delete;
  DeadProxy& operator=(const DeadProxy&) = delete;

 private:
  const char* const variable_;
};

TEST(Environment, ProxiesDoNotComeBetweenUnlessAskedFor) {
  const test::CommandService service(true);  // gRPC asks no proxy for a Unix socket
  for (const char* name : {"http_proxy", "grpc_proxy", "https_proxy"}) {
    const DeadProxy proxy(name);
    EXPECT_EQ(test::failure_of({"scenes", "--service", service.address()}), "") << name;
  }
  const DeadProxy proxy("http_proxy");
  Credentials asked;
  asked.proxy = true;
  EXPECT_FALSE(wait_connected(*make_channel(service.address(), asked), 0.1));
  EXPECT_NE(nobody_answers(service.address(), asked).find("through the proxy of the environment"),
            std::string::npos);
}

TEST(Environment, TokensDoNotPassAProxyInTheClear) {
  Credentials credentials;
  credentials.token = "secret";
  EXPECT_NO_THROW(require_usable(credentials, "127.0.0.1:50051"));
  credentials.proxy = true;
  EXPECT_THROW(require_usable(credentials, "127.0.0.1:50051"), std::runtime_error);
}

TEST(CommandLine, AddressesOfIpv6StandInBrackets) {
  for (const char* bare : {"::1:50051", "fe80::1:50051", "::1"})
    EXPECT_NE(address_problem(bare).find("an IPv6 address stands in brackets: [::1]:50051"),
              std::string::npos)
        << bare;
  for (const char* good : {"[::1]:50051", "localhost:50051", "127.0.0.1:50051"})
    EXPECT_EQ(address_problem(good), "");
}

// Before anything is done with them: JSON and messages would refuse them at the end.
TEST(CommandLine, NamesThatAreNoUtf8AreRefusedFirst) {
  const std::string name = "latin\xe4/pre.mha";
  for (const std::vector<std::string>& words :
       {std::vector<std::string>{"estimate", "--service", "unix:/tmp/tt-nobody", "--center-frequency-hz",
                                 "7e6", "--post", "b.mha", "--out", "/proc/nowhere", "--pre", name},
        {"touch", "--service", "unix:/tmp/tt-nobody", "--scene", "s", "--session", "latin\xe4"},
        {"acquire", "--service", "unix:/tmp/tt-nobody", "--seed", "1", "--scene", "latin\xe4"}}) {
    const std::string failure = test::failure_of(words);
    EXPECT_NE(failure.find(words[words.size() - 2] + ": its bytes are not UTF-8"), std::string::npos)
        << failure;
  }
}

TEST(CommandLine, TimeLimitsSayWhatTheyMayBe) {
  CLI::App app;
  add_commands(app);
  for (const char* command : {"estimate", "acquire"}) {
    const std::string help = app.get_subcommand(command)->help();
    const std::string limit = help.substr(help.find("--modulus-time-limit-s"));
    EXPECT_LT(limit.find("a service allows at most 60 s"), limit.find("\n  --")) << command;
    const std::string failure = test::failure_of({command, "--modulus-time-limit-s", "0"});
    EXPECT_EQ(failure, "--modulus-time-limit-s: must be a number above 0, not 0") << command;
  }
}

TEST(CommandLine, FormerOptionsNameWhatTakesTheirPlace) {
  for (const auto& [command, former, instead] :
       std::vector<std::array<std::string, 3>>{{"patient", "--write-tissue", "--save-tissue"},
                                               {"acquire", "--threads", "taskset"},
                                               {"acquire", "--start-direction", "--start-x-m"},
                                               {"touch", "--credit", "--period-s"}}) {
    const std::string failure = test::failure_of({command, former, "1"});
    EXPECT_NE(failure.find(former + ": no longer an option; "), std::string::npos) << failure;
    EXPECT_NE(failure.find(instead), std::string::npos) << failure;
  }
}

TEST(CommandLine, GroupsOfHelpStayReadable) {
  CLI::App app;
  add_commands(app);
  for (const CLI::App* command : app.get_subcommands({}))
    for (const std::string& group : command->get_groups()) {
      const auto in_it = [&group](const CLI::Option* option) { return option->get_group() == group; };
      EXPECT_LE(command->get_options(in_it).size(), 12U) << command->get_name() << ": " << group;
    }
}

TEST(CommandLine, OptionsThatDependOnOthersSayWhatToDo) {
  const auto message = [](std::vector<std::string> words) -> std::string {
    CLI::App app;
    add_commands(app);
    std::reverse(words.begin(), words.end());
    try {
      app.parse(words);
    } catch (const CLI::ParseError& error) {
      return usage_message(&app, error);
    }
    return "";
  };
  EXPECT_EQ(message({"acquire", "--service", "unix:/s", "--scene", "s", "--seed", "1", "--record-rf"}),
            "--record-rf requires --record; give both, or neither\n");
  EXPECT_EQ(message({"watch", "--session", "s", "--recording", "r"}),
            "--session excludes --recording; leave one of the two out\n");
  EXPECT_EQ(message({"scenes"}), "--service is required; see scenes --help\n");
  EXPECT_EQ(message({"scenes", "--server", "x"}), "no option '--server'; scenes --help lists them\n");
}

TEST(CommandLine, FoldersThatAnotherRunWritesAreRefusedFirst) {
  const TemporaryFolder folder;
  const std::string out = (folder / "out").string();
  const HeldFolder other(out);
  for (const std::vector<std::string>& words :
       {std::vector<std::string>{"estimate", "--service", "unix:/tmp/tt-nobody", "--center-frequency-hz",
                                 "7e6", "--frame", "PROBE", "--pre", "a.mha", "--post", "b.mha"},
        {"patient", "--seed", "7"},
        {"report", "--touch-record", "absent"}}) {
    std::vector<std::string> all = words;
    all.insert(all.end(), {"--out", out});
    const std::string failure = test::failure_of(all);
    EXPECT_NE(failure.find("another process writes its results there"), std::string::npos) << failure;
  }
}

}  // namespace
}  // namespace teletact::client
