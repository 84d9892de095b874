#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "client/files/metaimage.h"
#include "tests/commands/fake_service.h"

namespace teletact::client {
namespace {

class EstimateCommand : public testing::Test {
 protected:
  // Of so many pairs with one first frame.
  std::vector<std::string> words(int pairs) {
    std::vector<std::string> out{"estimate",
                                 "--service",
                                 service.address(),
                                 "--frame",
                                 "LAB",
                                 "--center-frequency-hz",
                                 "7e6",
                                 "--sampling-frequency-hz",
                                 "40e6",
                                 "--sound-speed-m-s",
                                 "1540",
                                 "--line-pitch-m",
                                 "0.0003",
                                 "--out",
                                 (service.folder / "out").string(),
                                 "--pre",
                                 frame("pre")};
    out.emplace_back("--post");
    for (int k = 0; k < pairs; ++k) out.push_back(frame("post" + std::to_string(k)));
    return out;
  }
  std::string frame(const std::string& name) {
    const auto path = service.folder / (name + ".mha");
    write_metaimage(path, MetaImage::of<std::int16_t>({8, 4}, {}, {}, std::vector<std::int16_t>(32)));
    return path.string();
  }
  std::string said_with(double mean_axial_strain) {
    service.estimates.mean_axial_strain = mean_axial_strain;
    testing::internal::CaptureStderr();
    const std::string failure = test::failure_of(words(1));
    return testing::internal::GetCapturedStderr() + failure;
  }
  test::CommandService service;
};

TEST_F(EstimateCommand, WarnsWhenTheTissueStretches) {
  const std::string stretched = said_with(0.01), pressed = said_with(-0.01);
  EXPECT_NE(stretched.find("are the two swapped?"), std::string::npos) << stretched;
  EXPECT_EQ(pressed.find("are the two swapped?"), std::string::npos) << pressed;
  EXPECT_EQ(service.estimates.calls, 2);
  EXPECT_TRUE(std::filesystem::exists(service.folder / "out" / "estimate.json")) << pressed;
}

TEST_F(EstimateCommand, ServiceThatAbortsAPairEndsAll) {
  const auto modulus = service.folder / "out" / "modulus.vti";
  service.estimates.aborted_call = 2;
  const std::string failure = test::failure_of(words(3));
  EXPECT_NE(failure.find("ABORTED"), std::string::npos) << failure;
  EXPECT_EQ(service.estimates.calls, 2);
  EXPECT_FALSE(std::filesystem::exists(modulus));
  service.estimates.aborted_call.reset();
  EXPECT_EQ(test::failure_of(words(3)), "");
  EXPECT_TRUE(std::filesystem::exists(modulus));
}

}  // namespace
}  // namespace teletact::client
