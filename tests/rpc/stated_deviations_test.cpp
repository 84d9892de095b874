// What a client states to be uncertain of its pair, from the contract to the estimate's input.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <string>

#include "service/rpc/estimate_messages.h"
#include "service/scene/errors.h"

namespace teletact::service {
namespace {

constexpr double kForceN = 0.2, kAreaM2 = 4e-4, kWidthM = 0.04;

// A solid's, 40 mm wide, of which everything is stated.
v1::Acquisition acquisition() {
  v1::Acquisition a;
  a.set_sample_count(2048), a.set_line_count(160), a.set_dtype(v1::DATA_TYPE_INT16);
  a.set_center_frequency_hz(7e6), a.set_sampling_frequency_hz(40e6), a.set_sound_speed_m_s(1500);
  a.set_line_pitch_m(kWidthM / 160), a.set_displacement_frame(v1::DISPLACEMENT_FRAME_PROBE);
  a.set_plane(v1::PLANE_CONDITION_SOLID), a.set_tissue_depth_m(0.05), a.set_tissue_width_m(0.1);
  a.set_probe_elevation_m(0.01);
  a.mutable_probe_force()->set_force_n(kForceN), a.mutable_probe_force()->set_contact_area_m2(kAreaM2);
  return a;
}

EstimateRequest settled(const v1::Acquisition& a) {
  const Scenes none{""};
  return request_from(a, none, Limits());
}

using Set = void (*)(v1::Acquisition&, double);

std::string refusal(const std::function<void(v1::Acquisition&)>& change) {
  v1::Acquisition a = acquisition();
  change(a);
  try {
    settled(a);
  } catch (const std::invalid_argument& refused) {
    return refused.what();
  }
  return "taken";
}

TEST(StatedDeviations, ReachTheEstimatesInput) {
  v1::Acquisition a = acquisition();
  v1::ProbeForce& force = *a.mutable_probe_force();
  force.set_force_std_n(0.01), force.set_force_zero_n(0.04), force.set_force_zero_std_n(0.02);
  force.set_force_gain(0.8), force.set_force_gain_std(0.04), force.set_contact_area_std_m2(4e-5);
  a.set_poisson_ratio_std(0.02), a.set_sound_speed_std_m_s(30), a.set_tissue_depth_std_m(0.004);
  a.set_tissue_width_std_m(0.01), a.set_probe_elevation_std_m(0.003);
  a.set_preload_m(0.003), a.set_preload_std_m(0.004);
  a.set_surface(v1::SURFACE_KIND_CAPSULE), a.set_capsule_thickness_m(0.002), a.set_capsule_ratio(3);
  a.set_capsule_ratio_std(0.5);
  const EstimateRequest r = settled(a);
  EXPECT_NEAR(r.force->force_n, (kForceN - 0.04) / 0.8, 1e-12);
  EXPECT_NEAR(r.force->own_deviation, std::hypot(0.01, 0.02) / 0.16, 1e-12);
  EXPECT_NEAR(r.force->shared_deviation, std::hypot(0.04 / 0.8, 0.005 / 0.05), 1e-12);
  EXPECT_NEAR(r.force_relative_deviation, std::hypot(r.force->own_deviation, 0.05), 1e-12);
  EXPECT_NEAR(r.area_relative_deviation, 0.1, 1e-12);
  EXPECT_EQ(r.tissue.poisson_std, 0.02);
  EXPECT_NEAR(r.sound_speed_deviation, 0.02, 1e-12);
  EXPECT_EQ(r.tissue.depth_std_m, 0.004);
  EXPECT_EQ(r.tissue.probe_elevation_std_m, 0.003);
  ASSERT_TRUE(r.tissue.beside_m);
  EXPECT_NEAR(*r.tissue.beside_m, (0.1 - kWidthM) / 2, 1e-12);
  EXPECT_NEAR(r.tissue.beside_std_m, 0.005, 1e-12);
  EXPECT_EQ(r.tissue.surface.kind, Surface::Kind::kCapsule);
  EXPECT_EQ(r.tissue.surface.ratio, 3);
  EXPECT_EQ(r.tissue.surface.ratio_std, 0.5);
  EXPECT_NEAR(r.tissue.surface.thickness_std_m, 0.0005, 1e-12) << "a quarter of it, where it is left out";
}

TEST(StatedDeviations, LeftOutAreTheDefaultsOfTheContract) {
  v1::Acquisition a = acquisition();
  a.clear_tissue_width_m(), a.clear_probe_elevation_m();
  const EstimateRequest r = settled(a);
  EXPECT_EQ(r.force->force_n, kForceN);
  EXPECT_EQ(r.force->own_deviation, 0.03);
  EXPECT_EQ(r.force->shared_deviation, 0) << "the area is the face's length, a solid's fit holds it";
  EXPECT_EQ(r.tissue.poisson_std, 0.01);
  EXPECT_EQ(r.sound_speed_deviation, 0.015);
  EXPECT_EQ(r.tissue.depth_std_m, 0);
  EXPECT_NEAR(r.tissue.probe_elevation_std_m, 0.05 * r.tissue.probe_elevation_m, 1e-12);
  EXPECT_FALSE(r.tissue.beside_m);
}

TEST(StatedDeviations, BeyondTheirValueOrWithoutItAreRefusedByName) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refused = [&](const char* field, Set set, double beyond) {
    for (const double bad : {-1e-6, beyond, nan, HUGE_VAL}) {
      const std::string said = refusal([&](auto& a) { set(a, bad); });
      EXPECT_EQ(said.find(std::string("acquisition.") + field + ": "), 0U) << bad << ": " << said;
      EXPECT_NE(said.find("leave it out"), std::string::npos) << said;
    }
  };
  refused(
      "probe_force.force_zero_std_n",
      [](auto& a, double v) { a.mutable_probe_force()->set_force_zero_std_n(v); }, -kForceN);
  refused(
      "probe_force.force_gain_std", [](auto& a, double v) { a.mutable_probe_force()->set_force_gain_std(v); },
      1);
  refused(
      "probe_force.force_gain", [](auto& a, double v) { a.mutable_probe_force()->set_force_gain(v); }, 11);
  refused(
      "poisson_ratio_std", [](auto& a, double v) { a.set_poisson_ratio_std(v); }, 0.2);
  refused(
      "sound_speed_std_m_s", [](auto& a, double v) { a.set_sound_speed_std_m_s(v); }, 1500);
  refused(
      "tissue_depth_std_m", [](auto& a, double v) { a.set_tissue_depth_std_m(v); }, 0.05);
  refused(
      "tissue_width_std_m", [](auto& a, double v) { a.set_tissue_width_std_m(v); }, 0.1);
  refused(
      "probe_elevation_std_m", [](auto& a, double v) { a.set_probe_elevation_std_m(v); }, 0.01);
  refused(
      "preload_std_m", [](auto& a, double v) { a.set_preload_std_m(v); }, 0.05);
  refused(
      "preload_m", [](auto& a, double v) { a.set_preload_m(v); }, 0.05);
  const auto of_capsule = [&](const char* field, Set set, double beyond) {
    for (const double bad : {0.0, -1e-6, beyond, nan, HUGE_VAL}) {
      const std::string said = refusal([&](auto& a) {
        a.set_surface(v1::SURFACE_KIND_CAPSULE), a.set_capsule_thickness_m(0.001), a.set_capsule_ratio(3);
        set(a, bad);
      });
      EXPECT_EQ(said.find(std::string("acquisition.") + field + ": "), 0U) << bad << ": " << said;
    }
  };
  of_capsule(
      "capsule_thickness_m", [](auto& a, double v) { a.set_capsule_thickness_m(v); }, 0.0031);
  of_capsule(
      "capsule_ratio", [](auto& a, double v) { a.set_capsule_ratio(v); }, 21);
  EXPECT_NE(refusal([](auto& a) { a.set_capsule_ratio(3); }).find("surface is not CAPSULE"),
            std::string::npos);
  EXPECT_NE(refusal([](auto& a) {
              a.set_surface(static_cast<v1::SurfaceKind>(9));
            }).find("acquisition.surface: unknown"),
            std::string::npos);
  for (const double bad : {kForceN, 2 * kForceN, nan})
    EXPECT_NE(refusal([&](auto& a) { a.mutable_probe_force()->set_force_zero_n(bad); }).find("force_zero_n"),
              std::string::npos);
  const auto alone = [&](const std::function<void(v1::Acquisition&)>& change) {
    EXPECT_NE(refusal(change).find("is not stated; state that too"), std::string::npos) << refusal(change);
  };
  alone([](auto& a) { a.clear_tissue_depth_m(), a.set_tissue_depth_std_m(0.001); });
  alone([](auto& a) { a.clear_tissue_width_m(), a.set_tissue_width_std_m(0.001); });
  alone([](auto& a) { a.clear_probe_elevation_m(), a.set_probe_elevation_std_m(0.001); });
  EXPECT_NE(refusal([](auto& a) {
              a.set_plane(v1::PLANE_CONDITION_STRAIN), a.clear_probe_elevation_m();
              a.set_probe_elevation_std_m(0.001);
            }).find("of solid tissue alone"),
            std::string::npos);
  EXPECT_NE(refusal([](auto& a) {
              a.set_plane(v1::PLANE_CONDITION_STRAIN), a.clear_probe_elevation_m();
              a.set_surface(v1::SURFACE_KIND_BARE);
            }).find("acquisition.surface: of solid tissue alone"),
            std::string::npos);
}

// As a sensor shows it, below zero too, of a pair that was hardly pressed: the next may tell more.
TEST(StatedDeviations, AForceWithinItsNoiseIsThePairsFault) {
  constexpr double kNoiseN = 0.002;
  const auto refusal = [](double force_n, double std_n, double zero_std_n) -> std::string {
    v1::Acquisition a = acquisition();
    v1::ProbeForce& force = *a.mutable_probe_force();
    force.set_force_n(force_n), force.set_force_std_n(std_n), force.set_force_zero_std_n(zero_std_n);
    try {
      settled(a);
    } catch (const Error& refused) {
      EXPECT_EQ(refused.kind, ErrorKind::kPrecondition);
      return refused.what();
    } catch (const std::invalid_argument&) {
      return "INVALID_ARGUMENT";
    }
    return "taken";
  };
  for (const double force_n : {kNoiseN, 0.5 * kNoiseN, 0.0, -4 * kNoiseN}) {
    EXPECT_EQ(refusal(force_n, kNoiseN, 0).find("acquisition.probe_force.force_n: "), 0U) << force_n;
    EXPECT_EQ(refusal(force_n, 0, kNoiseN), refusal(force_n, kNoiseN, 0));
  }
  const std::string said = refusal(0.0015, 0.002, 0.0015);
  for (const char* part : {"0.0015 N", "0.0025 N", "press further"})
    EXPECT_NE(said.find(part), std::string::npos) << said;
  EXPECT_EQ(refusal(1.01 * kNoiseN, kNoiseN, 0), "taken");
  EXPECT_EQ(refusal(-6 * kNoiseN, kNoiseN, 0), "INVALID_ARGUMENT") << "another sign is no noise";
  EXPECT_EQ(refusal(-kNoiseN, 0, 0), "INVALID_ARGUMENT");
}

TEST(StatedDeviations, APadIsOfASolidAlone) {
  const auto pad = [](auto& a) { a.set_pad_thickness_m(0.008), a.set_pad_youngs_modulus_pa(20e3); };
  v1::Acquisition stated = acquisition();
  pad(stated), stated.set_pad_youngs_modulus_std_pa(3e3);
  const EstimateRequest r = settled(stated);
  ASSERT_TRUE(r.tissue.pad);
  EXPECT_EQ(r.tissue.pad->youngs_modulus_std_pa, 3e3);
  EXPECT_NEAR(r.tissue.pad->thickness_std_m, 0.0004, 1e-12) << "a twentieth of it, where it is left out";
  EXPECT_FALSE(settled(acquisition()).tissue.pad);
  stated.clear_probe_force(), stated.set_preload_m(0.003), stated.set_preload_std_m(0.004);
  EXPECT_NEAR(settled(stated).tissue.pad->youngs_modulus_std_pa, std::hypot(3e3, 20e3 * 0.005 / 0.05), 1e-9);
  const auto refused = [&](const char* said, Set set, double value) {
    const std::string why = refusal([&](auto& a) { pad(a), set(a, value); });
    EXPECT_NE(why.find(said), std::string::npos) << value << ": " << why;
  };
  for (const double bad : {0.0, 0.0069, 1.0, -1.0, std::nan("")}) {
    refused(
        "pad_thickness_m: ", [](auto& a, double v) { a.set_pad_thickness_m(v); }, bad);
    refused(
        "pad_youngs_modulus_pa: ", [](auto& a, double v) { a.set_pad_youngs_modulus_pa(v); }, bad);
  }
  refused(
      "pad_thickness_std_m: ", [](auto& a, double v) { a.set_pad_thickness_std_m(v); }, 0.008);
  refused(
      "pad_youngs_modulus_std_pa: ", [](auto& a, double v) { a.set_pad_youngs_modulus_std_pa(v); }, 20e3);
  refused(
      "under a pad", [](auto& a, double) { a.set_surface(v1::SURFACE_KIND_BARE); }, 0);
  refused(
      "plane = SOLID", [](auto& a, double) { a.set_plane(v1::PLANE_CONDITION_STRAIN); }, 0);
  EXPECT_NE(refusal([](auto& a) { a.set_pad_thickness_std_m(0.001); }).find("pad_thickness_m: "),
            std::string::npos);
}

}  // namespace
}  // namespace teletact::service
