// What is no RF is refused, and what is doubtful is said: by what files state, and by how their samples
// oscillate.
#include "client/acquire/rf_checks.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <complex>

#include "client/acquire/recorded_frames.h"
#include "tests/acquire/echoes.h"
#include "tests/files/refusal.h"
#include "tests/files/temporary_folder.h"

namespace teletact::client {
namespace {

constexpr std::size_t kSamples = 512, kLines = 140;

const Baseband& echoes() {
  static const Baseband all = baseband(kSamples, kLines);
  return all;
}

std::vector<float> rf(double offset = 0) {
  return rf_of(echoes(), kSamples, offset);
}

std::vector<float> envelope() {
  return envelope_of(echoes());
}

std::vector<float> picture() {
  return made_of(echoes(),
                 [](std::complex<double> value) { return 40 * std::log10(std::abs(value) + 0.01) + 100; });
}

// I and Q in turn, at half the places.
std::vector<float> interleaved_iq() {
  std::vector<float> out(kSamples * kLines);
  for (std::size_t k = 0; k < out.size(); ++k) {
    const auto value = echoes()[k / 2 * 2];
    out[k] = static_cast<float>(100 * (k % 2 == 0 ? value.real() : value.imag()));
  }
  return out;
}

std::vector<float> in_phase() {
  return made_of(echoes(), [](std::complex<double> value) { return 100 * value.real(); });
}

constexpr double kPeriod = kEchoSamplingHz / kEchoHz;

TEST(RfAxis, IsWhereTheSamplesOscillate) {
  EXPECT_EQ(rf_axis(rf(), kSamples, kPeriod), RfAxis::kFastest);
  EXPECT_EQ(rf_axis(rf(5000), kSamples, kPeriod), RfAxis::kFastest) << "about another value than zero";
  EXPECT_EQ(rf_axis(turned(rf(), kSamples), kLines, kPeriod), RfAxis::kSlowest);
  for (const auto& samples : {envelope(), picture(), interleaved_iq(), in_phase()})
    EXPECT_EQ(rf_axis(samples, kSamples, kPeriod), RfAxis::kNeither);
  const std::vector<float> all = rf();
  std::vector<float> beneath(kSamples * 256);  // a standoff above the tissue
  for (std::size_t k = 0; k < beneath.size(); ++k)
    if (k % kSamples >= 128) beneath[k] = all[k % all.size()];
  EXPECT_EQ(rf_axis(beneath, kSamples, kPeriod), RfAxis::kFastest);
  constexpr std::size_t kFew = 60;  // lines, fewer than tell whether they oscillate
  const std::vector<float> narrow(all.begin(), all.begin() + kFew * kSamples);
  EXPECT_EQ(rf_axis(narrow, kSamples, kPeriod), RfAxis::kFastest);
  EXPECT_EQ(rf_axis(turned(narrow, kSamples), kFew, kPeriod), RfAxis::kSlowest);
  EXPECT_EQ(rf_axis(std::vector<float>(kSamples * kLines), kSamples, kPeriod), RfAxis::kUnclear) << "silence";
  EXPECT_EQ(rf_axis(std::vector<float>(20 * 20, 1), 20, kPeriod), RfAxis::kUnclear) << "too few";
}

class RecordedRf : public testing::Test {
 protected:
  // Two frames of `samples`, of which the header says this, too.
  template <class T = float>
  std::filesystem::path sequence(const std::vector<float>& samples, const std::string& fields,
                                 bool rows = false, const std::string& spacing = "1.925e-5 0.0003 1") {
    std::vector<T> both;
    for (int frame = 0; frame < 2; ++frame) both.insert(both.end(), samples.begin(), samples.end());
    const char* type = std::is_same_v<T, float>           ? "MET_FLOAT"
                       : std::is_same_v<T, std::uint16_t> ? "MET_USHORT"
                                                          : "MET_SHORT";
    const auto path = folder_ / "a.mha";
    put_content(path, fmt::format("ObjectType = Image\nNDims = 3\nElementSpacing = {}\n{}DimSize = {} {} 2\n"
                                  "ElementType = {}\nElementDataFile = LOCAL\n",
                                  spacing, fields, rows ? kLines : kSamples, rows ? kSamples : kLines, type) +
                          std::string(reinterpret_cast<const char*>(both.data()), both.size() * sizeof(T)));
    return path;
  }
  FramePair read(const std::filesystem::path& path) {
    RecordedFrameOptions options = options_;
    options.pre = options.post = path;
    options.pre_frame = 0, options.post_frame = 1;
    return read_recorded_frames(options);
  }
  std::string refusal(const std::filesystem::path& path) {
    return refusal_of<FrameInputError>([&] { read(path); });
  }
  std::string doubts(const std::filesystem::path& path) {
    std::string out;
    for (const std::string& doubt : read(path).doubts) out += doubt + "\n";
    return out;
  }
  static RecordedFrameOptions usual() {
    RecordedFrameOptions options;
    options.center_frequency_hz = kEchoHz;
    options.sampling_frequency_hz = kEchoSamplingHz;
    options.frame = "PROBE";
    return options;
  }
  RecordedFrameOptions options_ = usual();
  const TemporaryFolder folder_;
};

TEST_F(RecordedRf, ThatIsRfIsTakenWithoutAWord) {
  EXPECT_EQ(doubts(sequence(rf(), "")), "");
  EXPECT_EQ(doubts(sequence(rf(), "UltrasoundImageType = RF_REAL\nUltrasoundImageOrientation = FM\n")), "");
  EXPECT_EQ(read(sequence<std::int16_t>(rf(), "")).acquisition.dtype(), v1::DATA_TYPE_INT16);
}

TEST_F(RecordedRf, SamplesWithoutOscillationAreRefused) {
  for (const auto& samples : {envelope(), picture(), interleaved_iq(), in_phase()})
    for (const char* kind : {"", "UltrasoundImageType = RF_REAL\n", "UltrasoundImageType = BRIGHTNESS\n"}) {
      const std::string message = refusal(sequence(samples, kind));
      EXPECT_NE(message.find("do not oscillate along depth"), std::string::npos) << message;
      if (std::string(kind).find("BRIGHT") != std::string::npos) {
        EXPECT_NE(message.find("(UltrasoundImageType = BRIGHTNESS)"), std::string::npos) << message;
      }
    }
  // The turned spacing of a picture is not its first fault.
  EXPECT_NE(
      refusal(sequence(picture(), "UltrasoundImageOrientation = MFA\nUltrasoundImageType = BRIGHTNESS\n"))
          .find("do not oscillate"),
      std::string::npos);
}

TEST_F(RecordedRf, OfAnotherKindByItsHeaderIsContradictedAloud) {
  for (const char* kind : {"RF_IQ_LINE", "BRIGHTNESS"}) {  // SUPRA writes the latter whatever it is
    const std::string said = doubts(sequence(rf(), fmt::format("UltrasoundImageType = {}\n", kind)));
    EXPECT_NE(
        said.find(fmt::format(
            "says UltrasoundImageType = {}, but its samples oscillate as RF does, around 7.0 MHz", kind)),
        std::string::npos)
        << said;
  }
}

TEST_F(RecordedRf, AxesAreTakenAsTheHeaderSays) {
  const FramePair rows =
      read(sequence(turned(rf(), kSamples), "UltrasoundImageOrientation = MFA\n", true, "0.0003 1.925e-5 1"));
  EXPECT_EQ(rows.acquisition.sample_count(), kSamples);
  EXPECT_EQ(rows.acquisition.line_count(), kLines);
  EXPECT_EQ(rows.acquisition.line_pitch_m(), 0.0003);
  EXPECT_EQ(rows.pre, bytes_of(rf()));
  EXPECT_TRUE(rows.doubts.empty());
  EXPECT_NE(rows.made.find("UltrasoundImageOrientation = MFA"), std::string::npos) << rows.made;
  std::vector<float> backwards = rf();
  for (std::size_t l = 0; l < kLines; ++l)
    std::reverse(backwards.begin() + static_cast<std::ptrdiff_t>(l * kSamples),
                 backwards.begin() + static_cast<std::ptrdiff_t>((l + 1) * kSamples));
  EXPECT_EQ(read(sequence(backwards, "UltrasoundImageOrientation = NU\n")).pre, bytes_of(rf()))
      << "towards the probe";
  EXPECT_NE(refusal(sequence(rf(), "UltrasoundImageOrientation = MA\n")).find("is not a plane of A-lines"),
            std::string::npos);
}

TEST_F(RecordedRf, AxesThatTheSamplesContradictAreSaid) {
  const auto said = sequence(rf(), "UltrasoundImageOrientation = MF\n");
  EXPECT_EQ(read(said).pre, bytes_of(rf()));
  EXPECT_NE(doubts(said).find(
                "UltrasoundImageOrientation = MF contradicts its samples, which oscillate along the first"),
            std::string::npos)
      << doubts(said);
  const auto unsaid = sequence(turned(rf(), kSamples), "", true, "0.0003 1.925e-5 1");
  EXPECT_EQ(read(unsaid).pre, bytes_of(rf()));
  EXPECT_NE(doubts(unsaid).find("oscillate along the second dimension: that is taken as depth"),
            std::string::npos);
}

TEST_F(RecordedRf, OffsetsOfUnsignedSamplesAreTakenOff) {
  const FramePair pair = read(sequence<std::uint16_t>(rf(32768), ""));
  EXPECT_EQ(pair.acquisition.dtype(), v1::DATA_TYPE_FLOAT32);
  EXPECT_TRUE(pair.doubts.empty());
  const auto* samples = reinterpret_cast<const float*>(pair.pre.data());
  double sum = 0;
  for (std::size_t k = 0; k < kSamples * kLines; ++k) sum += samples[k];
  EXPECT_NEAR(sum / (kSamples * kLines), 0, 0.01);
  EXPECT_NEAR(samples[1000] - samples[1001], rf()[1000] - rf()[1001], 1);
}

TEST_F(RecordedRf, RatesThatTheEchoesContradictAreSaid) {
  const auto path = sequence(rf(), "", false, "1 1 1");  // states no spacing, as MetaIO writes it
  options_.line_pitch_m = 0.0003;
  EXPECT_EQ(doubts(path), "");
  options_.sampling_frequency_hz = 50e6;  // a quarter too much
  EXPECT_NE(doubts(path).find("above the 7.0 MHz stated, which tissue cannot cause. If the sampling "
                              "frequency is not 50.0 MHz, every length is wrong"),
            std::string::npos)
      << doubts(path);
  options_.sampling_frequency_hz = 32e6;  // a fifth too little
  EXPECT_NE(doubts(path).find("below the 7.0 MHz stated, as some scanners' do. If the sampling frequency is "
                              "not 32.0 MHz, every length is wrong"),
            std::string::npos)
      << doubts(path);
  options_.sampling_frequency_hz = 13e6;
  EXPECT_NE(refusal(path).find("more than twice the centre frequency"), std::string::npos);
}

// Of a bone or a needle; a crop that it fills more of has the frequency of the whole.
TEST_F(RecordedRf, FewLoudEchoesDoNotDecideTheFrequency) {
  const std::vector<float> usual = rf();
  std::vector<float> samples = usual;
  for (std::size_t l = 0; l < kLines; l += 10)
    for (std::size_t k = 0; k < kSamples / 2; ++k) {
      const std::size_t at = kSamples * l + 3 * k / 4;  // three quarters of the frequency
      samples[k + kSamples * l] = 50 * std::lerp(usual[at], usual[at + 1], static_cast<float>(3 * k % 4) / 4);
    }
  EXPECT_EQ(doubts(sequence(samples, "")), "");
}

TEST_F(RecordedRf, NanAndFramesThatAreInvalidAreRefused) {
  std::vector<float> samples = rf();
  samples[kSamples + 3] = NAN;
  EXPECT_NE(refusal(sequence(samples, "")).find("holds NaN or infinity"), std::string::npos);
  EXPECT_NE(refusal(sequence(rf(), "Seq_Frame0001_ImageStatus = INVALID\n"))
                .find("frame 1 is INVALID (Seq_Frame0001_ImageStatus); choose another with --post-frame"),
            std::string::npos);
  EXPECT_EQ(read(sequence(rf(), "Seq_Frame0000_Timestamp = 0.1\nSeq_Frame0001_Timestamp = 0.133\n")).made,
            "frames stamped 0.1 and 0.133 s");
}

TEST_F(RecordedRf, SpacingThatIsStatedOfEachFrameIsTaken) {
  const auto stated = [this](const std::string& spacing, const std::string& of_file = "1 1 1") {
    return sequence(
        rf(),
        "Seq_Frame0000_ElementSpacing = " + spacing + "\nSeq_Frame0001_ElementSpacing = " + spacing + "\n",
        false, of_file);
  };
  EXPECT_NEAR(read(stated("1.925e-5 0.0003 1")).acquisition.line_pitch_m(), 0.0003, 1e-9);
  EXPECT_NEAR(read(stated("7 7 1", "1.925e-5 0.0003 1")).acquisition.line_pitch_m(), 0.0003, 1e-9)
      << "the file's goes before";
  EXPECT_NE(refusal(stated("wide")).find("Seq_Frame0000_ElementSpacing = wide is not a spacing"),
            std::string::npos);
  options_.line_pitch_m = 0.0004;
  EXPECT_NE(refusal(stated("1.925e-5 0.0003 1")).find("--line-pitch-m 0.0004 contradicts"),
            std::string::npos);
}

TEST_F(RecordedRf, LengthsThatContradictEachOtherAreSaid) {
  const auto path = sequence(rf(), "", false, "1.925e-5 1.925e-5 1");  // SUPRA has one spacing for all
  EXPECT_NE(doubts(path).find("A-lines 0.01925 mm apart, exactly as the samples along depth"),
            std::string::npos);
  const auto good = sequence(rf(), "");
  options_.force_n = 1, options_.probe_elevation_m = 0.01;
  options_.contact_area_m2 = 0.01 * 0.0003 * kLines;
  EXPECT_EQ(doubts(good), "");
  *options_.contact_area_m2 *= 2;
  EXPECT_NE(doubts(good).find("is 2 times --probe-elevation-m"), std::string::npos) << doubts(good);
}

}  // namespace
}  // namespace teletact::client
