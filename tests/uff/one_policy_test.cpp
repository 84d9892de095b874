// What is no RF, or lies the wrong way round, is refused in a .mat and a .uff file as in an .mha.
#include <gtest/gtest.h>

#include "client/acquire/recorded_frames.h"
#include "client/acquire/rf_checks.h"
#include "tests/acquire/echoes.h"
#include "tests/files/matlab/write_uff.h"
#include "tests/files/refusal.h"
#include "tests/files/temporary_folder.h"

namespace teletact::client {
namespace {

constexpr double kSoundSpeed = 1540;
constexpr std::size_t kSamples = 300, kLines = 150;

std::vector<float> rf() {
  return rf_of(baseband(kSamples, kLines), kSamples);
}

class OnePolicy : public testing::Test {
 protected:
  RecordedFrameOptions options(const std::string& name) {
    RecordedFrameOptions out;
    out.pre = out.post = folder_ / name;
    out.center_frequency_hz = kEchoHz;
    out.frame = "PROBE";
    if (name.ends_with(".mat")) {
      out.sampling_frequency_hz = kEchoSamplingHz, out.line_pitch_m = 3e-4;
      out.variable = "pre", out.axial_axis = "rows";
    }
    return out;
  }
  static std::string refusal(const RecordedFrameOptions& options) {
    return refusal_of<FrameInputError>([&] { read_recorded_frames(options); });
  }
  void mat(const std::vector<float>& pre, const std::vector<float>& post) {
    UffFile file(folder_ / "a.mat");  // as h5py writes one
    file.numbers("pre", {kLines, kSamples}, pre);
    file.numbers("post", {kLines, kSamples}, post);
  }
  void uff(const std::vector<float>& values) {
    UffFile file(folder_ / "a.uff");
    write_beamformed(file, "b_data", {kLines, kSamples, 3e-4, kSoundSpeed / (2 * kEchoSamplingHz), 0}, values,
                     {});
  }
  const TemporaryFolder folder_;
};

TEST_F(OnePolicy, EnvelopesAreRefusedAlike) {
  const std::vector<float> envelope = envelope_of(baseband(kSamples, kLines));
  mat(envelope, envelope);
  uff(envelope);
  for (const char* name : {"a.mat", "a.uff"})
    EXPECT_NE(refusal(options(name)).find("holds an envelope or an image, or IQ, without the phase"),
              std::string::npos)
        << refusal(options(name));
}

TEST_F(OnePolicy, TheOtherAxisIsNamed) {
  mat(rf(), rf());
  uff(turned(rf(), kSamples));
  EXPECT_EQ(refusal(options("a.mat")), "no error");
  RecordedFrameOptions columns = options("a.mat");
  columns.axial_axis = "columns";
  EXPECT_NE(refusal(columns).find("give --axial-axis rows"), std::string::npos) << refusal(columns);
  EXPECT_NE(refusal(options("a.uff")).find("oscillate along x, not along z"), std::string::npos)
      << refusal(options("a.uff"));
}

TEST_F(OnePolicy, RatesThatTheEchoesContradictAreSaidAlike) {
  mat(rf(), rf());
  uff(rf());
  RecordedFrameOptions of_mat = options("a.mat"), of_uff = options("a.uff");
  of_mat.sampling_frequency_hz = 50e6;
  of_uff.center_frequency_hz = 5.6e6;
  for (const RecordedFrameOptions& o : {of_mat, of_uff}) {
    const auto doubts = read_recorded_frames(o).doubts;
    ASSERT_EQ(doubts.size(), 1u);
    EXPECT_NE(doubts[0].find("its echoes lie around"), std::string::npos) << doubts[0];
  }
  EXPECT_TRUE(read_recorded_frames(options("a.mat")).doubts.empty());
  EXPECT_TRUE(read_recorded_frames(options("a.uff")).doubts.empty());
}

TEST_F(OnePolicy, FramesMayBeTwoVariablesOfOneFile) {
  std::vector<float> post = rf();
  for (float& value : post) value *= 2;
  mat(rf(), post);
  RecordedFrameOptions two = options("a.mat");
  two.post_variable = "post";
  const FramePair pair = read_recorded_frames(two);
  EXPECT_EQ(pair.pre, bytes_of(rf()));
  EXPECT_EQ(pair.post, bytes_of(post));
}

}  // namespace
}  // namespace teletact::client
