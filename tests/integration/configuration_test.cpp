// The configuration file: it sets the limits that may be set, and what it may not say ends the service with
// one line.
#include <grpcpp/create_channel.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <iomanip>
#include <sstream>
#include <string>

#include "service/base/limits.h"
#include "teletact/v1/info.grpc.pb.h"
#include "tests/integration/process.h"

namespace teletact {
namespace {

using test::TemporaryFolder;

TEST(Configuration, LimitsAreSetByItAndAllAreReported) {
  TemporaryFolder folder;
  const std::string address = "unix:" + (folder / "s");
  const auto wanted = [](const service::LimitRow& row) {
    const double usual = row.value({});
    return !row.meaning ? usual : row.max != usual ? row.max : row.min;
  };
  {
    std::ofstream file(folder / "c.toml");
    file << "listen = \"" << address << "\"\ndevice = [\"0\"]\n[limits]\n" << std::setprecision(17);
    for (const service::LimitRow& row : service::limit_rows())
      if (row.meaning) file << row.name << " = " << wanted(row) << "\n";
  }
  test::Process service({test::service_binary(), "serve", "--config", folder / "c.toml"}, folder / "log");
  ASSERT_TRUE(service.says("serving on", 120)) << service.output();
  const auto channel = grpc::CreateChannel(address, grpc::InsecureChannelCredentials());
  grpc::ClientContext context;
  v1::GetInfoResponse info;
  ASSERT_TRUE(v1::Info::NewStub(channel)->GetInfo(&context, {}, &info).ok());
  ASSERT_EQ(static_cast<std::size_t>(info.limits_size()), service::limit_rows().size());
  for (int k = 0; k < info.limits_size(); ++k)
    EXPECT_EQ(info.limits(k).value(), wanted(service::limit_rows()[static_cast<std::size_t>(k)]))
        << info.limits(k).name();
}

// As many connections as the system lets it have, whatever the shell that started it had set.
TEST(Configuration, OpenFilesAreRaisedToWhatTheSystemAllows) {
  TemporaryFolder folder;
  test::Process service({"/bin/sh", "-c", "ulimit -Sn 64; exec \"$0\" serve --listen \"unix:$1\"",
                         test::service_binary(), folder / "s"},
                        folder / "log");
  ASSERT_TRUE(service.says("serving on", 120)) << service.output();
  std::ifstream limits("/proc/" + std::to_string(service.id()) + "/limits");
  std::string line, soft, hard;
  const std::string name = "Max open files";
  while (std::getline(limits, line))
    if (line.starts_with(name)) std::istringstream(line.substr(name.size())) >> soft >> hard;
  EXPECT_EQ(soft, hard);
  EXPECT_NE(soft, "");
  EXPECT_NE(soft, "64");
}

TEST(Configuration, WhatIsNoLimitOrBeyondItsRangeIsNamed) {
  TemporaryFolder folder;
  const auto refused = [&](const std::string& text, const std::string& word) {
    std::ofstream(folder / "c.toml") << "listen = 'unix:" + (folder / "s") + "'\n" + text;
    const auto outcome =
        test::run({test::service_binary(), "serve", "--config", folder / "c.toml"}, folder / "log");
    EXPECT_EQ(outcome.code, 1) << outcome.output;
    EXPECT_NE(outcome.output.find(word), std::string::npos) << outcome.output;
    EXPECT_EQ(std::count(outcome.output.begin(), outcome.output.end(), '\n'), 1) << outcome.output;
  };
  refused("[limits]\nmax_spoons = 3\n", "limits.max_spoons");
  refused("[limits]\nmax_scenes = 0\n", "limits.max_scenes: 0 is not within [1, 4096]");
  refused("[limits]\nmax_scenes = 2.5\n", "limits.max_scenes");
  refused("[limits]\nmove_s = nan\n", "limits.move_s: nan is not within");
  refused("[limits]\nmax_max_strain = 0.1\n",
          "limits.max_max_strain: it is a constant, 0.125; take the line out");
  refused("[limits]\nmax_scenes = \"many\"\n", "limits.max_scenes must be a number");
  refused("limits = 3\n", "limits must be a table");
  refused("pairs_at_once = 0\n", "pairs_at_once must be a whole number from 1 to 16");
  refused("pairs_at_once = 17\n", "pairs_at_once must be a whole number from 1 to 16");
  refused("device = [0]\n", "device must be a string, or a list of strings");
  refused("device = []\n", "device is an empty list");
  refused("device = [\"0\", \"0\"]\n", "is chosen already");
  refused("max_scenes = 3\n", "unknown key \"max_scenes\"");
}

}  // namespace
}  // namespace teletact
