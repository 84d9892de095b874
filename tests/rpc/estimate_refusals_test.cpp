// What an estimate refuses of an acquisition and its frames, and that it leaves nothing behind.
#include <cstring>
#include <limits>
#include <random>

#include "tests/rpc/estimates.h"

namespace teletact::service {
namespace {

TEST_F(Estimates, SenselessAcquisitionsNameTheField) {
  using enum grpc::StatusCode;
  Bystander bystander(server->channel(), "s");
  const auto refused = [&](grpc::StatusCode code, const char* field, auto change) {
    v1::Acquisition a = acquisition("scene");
    change(a);
    Elastographer call(channel);
    call.send(a);
    expect_refused(call.finish(), code, field);
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  refused(INVALID_ARGUMENT, "acquisition.sampling_frequency_hz",
          [](auto& a) { a.set_sampling_frequency_hz(0); });
  refused(INVALID_ARGUMENT, "acquisition.sampling_frequency_hz",
          [&](auto& a) { a.set_sampling_frequency_hz(nan); });
  refused(INVALID_ARGUMENT, "acquisition.sampling_frequency_hz",
          [](auto& a) { a.set_sampling_frequency_hz(14e6); });
  refused(INVALID_ARGUMENT, "acquisition.center_frequency_hz",
          [](auto& a) { a.set_center_frequency_hz(-7e6); });
  refused(INVALID_ARGUMENT, "centre frequency in Hz", [](auto& a) { a.set_center_frequency_hz(7.3); });
  refused(INVALID_ARGUMENT, "acquisition.sound_speed_m_s", [](auto& a) { a.set_sound_speed_m_s(0); });
  refused(INVALID_ARGUMENT, "acquisition.line_pitch_m", [](auto& a) { a.set_line_pitch_m(0); });
  refused(INVALID_ARGUMENT, "acquisition.first_sample_depth_m",
          [](auto& a) { a.set_first_sample_depth_m(-1); });
  refused(INVALID_ARGUMENT, "acquisition.dtype", [](auto& a) { a.set_dtype(v1::DATA_TYPE_FLOAT64); });
  refused(INVALID_ARGUMENT, "acquisition.sample_count", [](auto& a) { a.set_sample_count(63); });
  refused(INVALID_ARGUMENT, "acquisition.line_count", [](auto& a) { a.set_line_count(0); });
  refused(INVALID_ARGUMENT, "acquisition.displacement_frame", [](auto& a) { a.clear_displacement_frame(); });
  refused(INVALID_ARGUMENT, "acquisition.poisson_ratio", [](auto& a) { a.set_poisson_ratio(0.5); });
  refused(INVALID_ARGUMENT, "acquisition.poisson_ratio", [](auto& a) { a.set_poisson_ratio(0.499999); });
  refused(INVALID_ARGUMENT, "acquisition.probe_force", [](auto& a) { a.clear_probe_force(); });
  for (const double wrong_unit : {1e-4, 1e4})
    refused(INVALID_ARGUMENT, "acquisition.probe_force.contact_area_m2", [wrong_unit](auto& a) {
      a.mutable_probe_force()->set_contact_area_m2(wrong_unit * a.probe_force().contact_area_m2());
    });
  refused(INVALID_ARGUMENT, "acquisition.probe_force.force_n",
          [](auto& a) { a.mutable_probe_force()->set_force_n(-1); });
  for (const double bad : {-0.1, nan, std::numeric_limits<double>::infinity()})
    refused(INVALID_ARGUMENT, "acquisition.probe_force.force_std_n",
            [bad](auto& a) { a.mutable_probe_force()->set_force_std_n(bad); });
  // That of a pair which was hardly pressed is no mistake of who states it: another may be taken.
  refused(FAILED_PRECONDITION, "acquisition.probe_force.force_n: 2 N is no more than its noise of 2.1 N",
          [](auto& a) { a.mutable_probe_force()->set_force_std_n(2.1); });
  refused(INVALID_ARGUMENT, "acquisition.probe_force.contact_area_std_m2", [](auto& a) {
    a.mutable_probe_force()->set_contact_area_std_m2(a.probe_force().contact_area_m2());
  });
  // What the scene states otherwise: it is 0.1 m wide, 0.02 m deep, and has nu = 0.49.
  refused(INVALID_ARGUMENT, "acquisition.poisson_ratio: 0.45", [](auto& a) { a.set_poisson_ratio(0.45); });
  refused(INVALID_ARGUMENT, "acquisition.tissue_depth_m: 0.03", [](auto& a) { a.set_tissue_depth_m(0.03); });
  refused(INVALID_ARGUMENT, "acquisition.tissue_width_m: 0.2", [](auto& a) { a.set_tissue_width_m(0.2); });
  refused(INVALID_ARGUMENT, "acquisition.max_strain", [](auto& a) { a.set_max_strain(2); });
  refused(INVALID_ARGUMENT, "acquisition.maps", [](auto& a) { a.add_maps("colour"); });
  refused(INVALID_ARGUMENT, "acquisition.line_pitch_m x line_count",
          [](auto& a) { a.set_line_count(200), a.set_line_pitch_m(5e-3); });
  refused(INVALID_ARGUMENT, "acquisition.plane", [](auto& a) { a.set_plane(v1::PLANE_CONDITION_STRESS); });
  refused(INVALID_ARGUMENT, "acquisition.modulus_method",
          [](auto& a) { a.set_modulus_method(v1::MODULUS_METHOD_SOLID); });
  refused(INVALID_ARGUMENT, "acquisition.modulus_method", [](auto& a) {
    a.set_plane(v1::PLANE_CONDITION_SOLID);
    a.set_modulus_method(v1::MODULUS_METHOD_DIRECT);
  });
  refused(INVALID_ARGUMENT, "acquisition.probe_elevation_m", [](auto& a) { a.set_probe_elevation_m(0.01); });
  for (const double elevation_m : {-0.01, 1.0, double(NAN)})
    refused(INVALID_ARGUMENT, "acquisition.probe_elevation_m", [=](auto& a) {
      a.set_plane(v1::PLANE_CONDITION_SOLID);
      a.set_probe_elevation_m(elevation_m);
    });
  // Which slice of a solid: a plane has none, there is no such scene, or it is no solid.
  const auto slice_of = [](auto& a, const char* scene, double y_m, double z_m) {
    a.set_plane(v1::PLANE_CONDITION_SOLID);
    a.clear_publish();
    a.mutable_slice_of()->set_scene_id(scene);
    for (const double o : {0.0, y_m, z_m}) a.mutable_slice_of()->mutable_window()->add_origin_m(o);
  };
  refused(INVALID_ARGUMENT, "acquisition.slice_of", [&](auto& a) {
    slice_of(a, "scene", 0, 0);
    a.set_plane(v1::PLANE_CONDITION_STRAIN);
  });
  refused(INVALID_ARGUMENT, "acquisition.slice_of", [&](auto& a) {  // and published into a plane
    const v1::Publish publish = a.publish();
    slice_of(a, "scene", 0, 0);
    *a.mutable_publish() = publish;
  });
  refused(NOT_FOUND, "scene_id", [&](auto& a) { slice_of(a, "nowhere", 0, 0); });
  refused(FAILED_PRECONDITION, "scene_id", [&](auto& a) { slice_of(a, "scene", 0, 0); });
  refused(INVALID_ARGUMENT, "slice_of.window.origin_m[1]", [&](auto& a) { slice_of(a, "scene", 0.001, 0); });
  refused(INVALID_ARGUMENT, "slice_of.window.origin_m", [&](auto& a) { slice_of(a, "scene", 0, nan); });
  refused(INVALID_ARGUMENT, "acquisition.maps", [](auto& a) {  // each would be sent
    for (int k = 0; k < 100'000; ++k) a.add_maps("valid");
  });
  const auto window = [](auto& a) { return a.mutable_publish()->mutable_window(); };
  for (const double x_m : {0.09, nan})
    refused(INVALID_ARGUMENT, "publish.window.origin_m", [&](auto& a) { window(a)->set_origin_m(0, x_m); });
  refused(INVALID_ARGUMENT, "publish.window.origin_m", [](auto& a) { a.mutable_publish()->clear_window(); });
  // a plane scene has one plane, and its probe presses from above
  refused(INVALID_ARGUMENT, "publish.window.origin_m[1]",
          [&](auto& a) { window(a)->set_origin_m(1, 0.001); });
  refused(INVALID_ARGUMENT, "publish.window.origin_m[2]", [&](auto& a) { window(a)->add_origin_m(0.001); });
  refused(INVALID_ARGUMENT, "publish.window.lateral", [&](auto& a) {
    for (const double component : {-1.0, 0.0, 0.0}) window(a)->add_lateral(component);
  });
  refused(INVALID_ARGUMENT, "publish.window.axial", [&](auto& a) {
    for (const double component : {0.0, 0.8, 0.6}) window(a)->add_axial(component);
  });
  refused(NOT_FOUND, "scene_id", [](auto& a) { a.mutable_publish()->set_scene_id("nowhere"); });
  refused(FAILED_PRECONDITION, "publish.scene_id", [](auto& a) { a.mutable_publish()->set_scene_id("s"); });
  refused(RESOURCE_EXHAUSTED, "acquisition.sample_count", [](auto& a) {  // 10 GB a frame
    a.set_sample_count(50000), a.set_line_count(50000);
  });
  refused(RESOURCE_EXHAUSTED, "acquisition.sample_count",
          [](auto& a) { a.set_sample_count(UINT32_MAX), a.set_line_count(UINT32_MAX); });
  bystander.stop();
  EXPECT_EQ(bystander.failures(), 0);
  EXPECT_EQ(scene().version(), 0U);
}

TEST_F(Estimates, BrokenUploadsLeaveNothingBehind) {
  Bystander bystander(server->channel(), "s");
  const auto& [pre, post] = pair();
  using enum grpc::StatusCode;
  expect_refused(estimate(acquisition("scene"), pre, post.substr(0, post.size() / 2)), INVALID_ARGUMENT,
                 "post frame");
  expect_refused(estimate(acquisition("scene"), pre.substr(0, pre.size() - 4), post), INVALID_ARGUMENT,
                 "pre frame");
  expect_refused(estimate(acquisition("scene"), "", ""), INVALID_ARGUMENT, "pre frame");
  expect_refused(estimate(acquisition("scene"), pre + "more", post), INVALID_ARGUMENT, "sample_count");
  for (const float bad :
       {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(), 3e38F, -1e16F}) {
    std::string spoiled = post;
    std::memcpy(spoiled.data() + 4 * (3 * kSamples + 17), &bad, sizeof(bad));
    expect_refused(estimate(acquisition("scene"), pre, spoiled), INVALID_ARGUMENT,
                   "sample 17 of A-line 3 of the post frame");
  }
  {
    Elastographer call(channel);
    call.send(acquisition("scene"));
    call.send(v1::FRAME_KIND_PRE, 0, pre.substr(0, 1000));
    call.send(v1::FRAME_KIND_PRE, 2000, pre.substr(2000, 1000));
    expect_refused(call.finish(), INVALID_ARGUMENT, "chunk.offset_bytes");
  }
  {
    Elastographer call(channel);
    call.send(acquisition("scene"));
    call.send(v1::FRAME_KIND_UNSPECIFIED, 0, "abcd");
    expect_refused(call.finish(), INVALID_ARGUMENT, "chunk.frame");
  }
  {
    Elastographer call(channel);
    call.send(v1::FRAME_KIND_PRE, 0, "abcd");
    expect_refused(call.finish(), INVALID_ARGUMENT, "acquisition");
  }
  {
    Elastographer call(channel);  // larger than any message may be
    call.send(acquisition("scene"));
    call.send(v1::FRAME_KIND_PRE, 0, std::string(3 << 20, 'x'));
    EXPECT_EQ(call.finish().status.error_code(), RESOURCE_EXHAUSTED);
  }
  bystander.stop();
  EXPECT_EQ(bystander.failures(), 0);
  EXPECT_EQ(scene().version(), 0U);
}

TEST_F(Estimates, UnrelatedFramesAreRefusedAsUntrackable) {
  std::string noise(pair().pre.size(), '\0');
  std::mt19937 random(3);
  std::normal_distribution<float> normal;
  for (std::size_t n = 0; n + 4 <= noise.size(); n += 4) {
    const float v = normal(random);
    std::memcpy(noise.data() + n, &v, 4);
  }
  expect_refused(estimate(acquisition("scene"), pair().pre, noise), grpc::StatusCode::FAILED_PRECONDITION,
                 "");
  EXPECT_EQ(scene().version(), 0U);
}

}  // namespace
}  // namespace teletact::service
