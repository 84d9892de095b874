#include "client/commands/device_options.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "tests/commands/fake_service.h"

namespace teletact::client {
namespace {

class DeviceSettings : public testing::Test {
 protected:
  // Parses the settings in place of "FILE".
  void parse(const std::string& settings, std::vector<std::string> words = {"--device-settings", "FILE"}) {
    const std::string path = (folder_ / "omega.toml").string();
    put_content(path, settings);
    std::replace(words.begin(), words.end(), std::string("FILE"), path);
    std::reverse(words.begin(), words.end());  // as CLI11 takes them
    CLI::App command;
    command.add_option("--device", device);
    add_device_settings(command);
    add_workspace_options(command, workspace);
    add_scale_options(command, workspace);
    command.parse(words);
  }
  void expect_refused(const std::string& settings, const std::vector<std::string>& parts) {
    try {
      parse(settings);
      ADD_FAILURE() << "taken: " << settings;
    } catch (const UsageError& error) {
      const std::string line = error.what();
      EXPECT_EQ(line.find('\n'), std::string::npos) << line;
      for (const std::string& part : parts) EXPECT_NE(line.find(part), std::string::npos) << line;
    }
  }
  std::string device = "simulated";
  WorkspaceOptions workspace;
  const TemporaryFolder folder_;
};

TEST_F(DeviceSettings, HoldTheDeviceAndItsOptions) {
  parse(R"(device = "plugin:omega.so,library=/opt/lib.so"
axes = "z,y,-x"
scale = 4
force_scale = 0.25
clutch_button = 2
device_without_noise = true
)");
  EXPECT_EQ(device, "plugin:omega.so,library=/opt/lib.so");
  EXPECT_EQ(workspace.axes, "z,y,-x");
  EXPECT_EQ(workspace.scale, 4);
  EXPECT_EQ(workspace.force_scale, 0.25);
  EXPECT_EQ(workspace.clutch_button, 2U);
  EXPECT_TRUE(workspace.without_noise);
  EXPECT_EQ(workspace.rotation_deg, 0);
}

TEST_F(DeviceSettings, YieldToTheCommandLine) {
  for (const std::vector<std::string>& words :
       {std::vector<std::string>{"--device-settings", "FILE", "--scale", "3"},
        {"--scale", "3", "--device-settings", "FILE"}}) {
    parse("scale = 4\nrotation_deg = 30\n", words);
    EXPECT_EQ(workspace.scale, 3) << words.front();
    EXPECT_EQ(workspace.rotation_deg, 30) << words.front();
  }
}

TEST_F(DeviceSettings, NameAnUnknownKeyItsLineAndTheKnownOnes) {
  expect_refused("scale = 4\nforce-scale = 1\n",
                 {"omega.toml", "line 2: force-scale: unknown key", "device, axes", "scale, force_scale"});
  expect_refused("[workspace]\nscale = 4\n", {"line 1: workspace: unknown key"});
  expect_refused("\"a\\u001bb\" = 1", {"a?b"});
}

TEST_F(DeviceSettings, NameTheLineOfAValueOfAnotherKind) {
  expect_refused("axes = \"x,y,z\"\nscale = \"four\"\n", {"line 2: scale", "four"});
  expect_refused("device_without_noise = 1\n", {"device_without_noise: must be true or false"});
  expect_refused("axes = [1, 2]\n", {"axes: must be a number or a string"});
  expect_refused("scale = true\n", {"scale: must be a number or a string"});
  expect_refused("clutch_button = -1\n", {"clutch_button", "-1"});
  expect_refused("scale 4\n", {"--device-settings", "omega.toml", "line 1"});
}

TEST_F(DeviceSettings, AreRefusedForAnotherKindOfDevice) {
  const std::string path = (folder_ / "omega.toml").string();
  const auto failure = [&](const std::string& settings) {
    put_content(path, settings);
    return test::failure_of(
        {"touch", "--service", "unix:/tmp/tt-nobody", "--scene", "s", "--device-settings", path});
  };
  EXPECT_EQ(failure("scale = 2\n").find("--scale: --device simulated has no such option"), 0U);
  EXPECT_EQ(failure("device = \"inverse3\"\nhand_mass_kg = 0.1\n").find("--hand-mass-kg: --device inverse3"),
            0U);
  EXPECT_NE(
      failure("device = \"inverse3\"\nscale = nan\n").find("line 2: scale: --scale: must be a finite number"),
      std::string::npos);
  EXPECT_EQ(failure("device = \"inverse3\"\nscale = 30\n").find("--scale: give 1 to 20"), 0U);
}

}  // namespace
}  // namespace teletact::client
