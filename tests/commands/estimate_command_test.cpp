#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
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

TEST_F(EstimateCommand, UncertaintiesAreSentAndKept) {
  std::vector<std::string> command = words(1);
  for (const char* word : {"--force-n",
                           "0.2",
                           "--contact-area-m2",
                           "4e-4",
                           "--tissue-depth-m",
                           "0.05",
                           "--tissue-width-m",
                           "0.1",
                           "--probe-elevation-m",
                           "0.01",
                           "--force-std-n",
                           "0.01",
                           "--force-zero-n",
                           "-0.02",
                           "--force-zero-std-n",
                           "0.03",
                           "--force-gain",
                           "1.04",
                           "--force-gain-std",
                           "0.05",
                           "--contact-area-std-m2",
                           "6e-6",
                           "--probe-elevation-std-m",
                           "0.007",
                           "--tissue-depth-std-m",
                           "0.008",
                           "--tissue-width-std-m",
                           "0.009",
                           "--poisson-ratio-std",
                           "0.011",
                           "--sound-speed-std-m-s",
                           "12",
                           "--preload-m",
                           "0.0013",
                           "--preload-std-m",
                           "0.0014",
                           "--surface",
                           "capsule",
                           "--capsule-thickness-m",
                           "0.001",
                           "--capsule-ratio",
                           "3",
                           "--capsule-thickness-std-m",
                           "0.0002",
                           "--capsule-ratio-std",
                           "0.5",
                           "--pad-thickness-m",
                           "0.008",
                           "--pad-youngs-modulus-pa",
                           "2e4",
                           "--pad-thickness-std-m",
                           "0.0003",
                           "--pad-youngs-modulus-std-pa",
                           "900"})
    command.emplace_back(word);
  ASSERT_EQ(test::failure_of(command), "");
  const v1::Acquisition& a = service.estimates.acquisition;
  const v1::ProbeForce& f = a.probe_force();
  const std::vector<double> sent{f.force_n(),
                                 f.force_std_n(),
                                 f.force_zero_n(),
                                 f.force_zero_std_n(),
                                 f.force_gain(),
                                 f.force_gain_std(),
                                 f.contact_area_std_m2(),
                                 a.probe_elevation_std_m(),
                                 a.tissue_depth_std_m(),
                                 a.tissue_width_std_m(),
                                 a.poisson_ratio_std(),
                                 a.sound_speed_std_m_s(),
                                 a.preload_m(),
                                 a.preload_std_m(),
                                 a.capsule_thickness_m(),
                                 a.capsule_ratio(),
                                 a.capsule_thickness_std_m(),
                                 a.capsule_ratio_std(),
                                 a.pad_thickness_m(),
                                 a.pad_youngs_modulus_pa(),
                                 a.pad_thickness_std_m(),
                                 a.pad_youngs_modulus_std_pa()};
  EXPECT_EQ(a.surface(), v1::SURFACE_KIND_CAPSULE);
  EXPECT_EQ(sent,
            (std::vector<double>{0.2, 0.01,   -0.02,  0.03,  1.04, 0.05,   6e-6, 0.007, 0.008, 0.009,  0.011,
                                 12,  0.0013, 0.0014, 0.001, 3,    0.0002, 0.5,  0.008, 2e4,   0.0003, 900}));
  const auto json = nlohmann::json::parse(std::ifstream(service.folder / "out" / "estimate.json"));
  EXPECT_EQ(json.at("acquisition").at("probe_force").at("force_zero_std_n"), 0.03);
  EXPECT_EQ(json.at("acquisition").at("preload_std_m"), 0.0014);
  std::vector<std::string> none = words(1), relative = words(1);
  none.insert(none.end(), {"--poisson-ratio-std", "0"});
  relative.insert(relative.end(), {"--force-std-n", "0.1"});
  EXPECT_NE(test::failure_of(none), "") << "on the wire it would be the default";
  EXPECT_NE(test::failure_of(relative).find("--force-n"), std::string::npos);
}

}  // namespace
}  // namespace teletact::client
