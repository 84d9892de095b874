// What touch and estimates are computed with and trusted for, chosen by constants: meshes, ways of solving,
// times, thresholds. A planner that chooses from what a scene needs takes their place. Lengths in metres,
// times in seconds.
#pragma once

#include <chrono>
#include <cstddef>

namespace teletact::service::choices {

// The tissue that a window is touched on (scene/tissue_models.h).
inline constexpr double kFine = 0.001;       // columns under the finger; rows down to kFineDepth
inline constexpr double kCoarse = 0.008;     // columns far away
inline constexpr double kCoarseRow = 0.002;  // rows below kFineDepth
inline constexpr double kFineDepth = 0.022;
inline constexpr double kColumnGrowth = 1.3, kRowGrowth = 1.15;  // from fine to coarse
// Tissue on each side of the window (T4). 60 mm leave a jump of 1.8 % where a finger is handed over at the
// tissue's border; 80 mm leave 1.0 %, 100 mm 0.5 %, for 5 more coarse columns a side.
inline constexpr double kContext = 0.100;
inline constexpr double kRefresh = 0.060;  // windows this near are rebuilt when a window changes

// The finger on it.
inline constexpr double kHandOver = 0.002;  // it may leave its window by this much before it is handed over
inline constexpr double kWidestReach = 0.014;  // half of the widest contact
// What is curved of a tip and overlaps must span so many spacings of nodes on each side, or the force may
// depend on where it stands between them by more than 5 % (at 3.5, 2.8, 2 and 1.4 spacings by 1 to 2.3, 3 to
// 7, 11 to 17 and 18 to 23 %).
inline constexpr double kMinSpacings = 1.5;
inline constexpr double kMinPadSpacings = 4.4;  // all of a pad (solid_contact_test)

// A light touch: what fingers make out stiffness with before they press.
inline constexpr double kLightTouch = 5e-4;
// Nodes whose gap to the tip is smaller than this fraction of the indentation may touch (tissue bulges beside
// the tip); the range grows by itself while its outermost node touches.
inline constexpr double kCandidateMargin = 0.25;

// Which way a row is condensed: interior rows that wide tissue condenses one by one. About then all of them
// row by row are as cheap.
inline constexpr std::size_t kRowsByColumns = 4;
// Interior rows that are kept, those used last, at 8 bytes for each pair of freedoms of a row; one more
// is made again when it is asked for. One is always kept, and those that somebody holds are.
inline constexpr std::size_t kMaxComplianceBytes = std::size_t{256} << 20;

// How conjugate gradients solve. Devices without double: up to here float alone converges at any contrast
// tested on square elements.
inline constexpr double kFloatPoissonRatio = 0.495;
// Of a column in double: a compliance is off by the square of it.
inline constexpr double kColumnError = 1e-4;

// The longest that an answer waits for what its contact needs (FAILED then; what is ready by then is kept),
// and what it spends after that on what the finger may touch next.
inline constexpr std::chrono::milliseconds kLongestSolve{200}, kAhead{5};
// Force error beyond which an answer is not trusted: that of a float solver.
inline constexpr double kTrustedForceError = 2e-3;
// The same where it is being corrected while the finger moves on: less than is told apart by touch. Who was
// given a trusted one so short a time before waits for no correction.
inline constexpr double kTrustedMeanwhile = 0.05;
inline constexpr std::chrono::milliseconds kTrustLasts{100};
// What a model may put the force off by, beside that, before its answers are not trusted: half of what a
// finger that presses can tell.
inline constexpr double kTrustedModelError = 0.03;
// Tissue that a touch feels: as wide as a wide tip, and so deep in all, half of it above the row where the
// surface leaves room. Where less than this share of its cells was measured, the answer is not trusted.
inline constexpr double kFeltDepth = 0.025;
inline constexpr double kTrustedShare = 0.5;

// Between tactile images, at least.
inline constexpr std::chrono::milliseconds kTactilePeriod{20};
// How the touched layer gives way, for those who look on: between two, at least; so far around the finger,
// and so many nodes.
inline constexpr std::chrono::microseconds kSurfacePeriod{16667};
inline constexpr double kSurfaceAround = 0.020;
inline constexpr std::size_t kMaxSurfaceNodes = 1089;

// Contact laws (contact/law_sampler.h): what the force that is interpolated may be off by; columns of samples
// that every law has, on one lattice of the scene whose pitch is no multiple of a mesh's, so that they do not
// share its phase, and how near to a window's end the last one stands; the depths that every column has.
inline constexpr double kLawShare = 0.005, kLawFloor = 0.001;
inline constexpr double kLawPitch = 0.00618, kLawLeastCell = 0.001;
inline constexpr double kLawDepths[] = {3e-4, 9e-4, 2.7e-3, 8e-3};
// What a cell is halved beyond, of the tolerance, that was not halved yet, once, twice. What is tried is a
// little better than what lies between. The third time it becomes finer than the mesh: for ripples of it
// alone.
inline constexpr double kLawKept[] = {0.58, 0.68, 1.0};
// Of a stuck tip deeper or finer columns take many times the samples.
inline constexpr double kStuckLawDepths[] = {3e-4, 7e-4, 1.7e-3, 4e-3}, kStuckLawKept[] = {0.85, 0.85};
// Above the first depth poses are tried down to about this share of it.
inline constexpr double kLawLightest = 0.45;
// What the worst of the poses that were tried around a column is multiplied with to say what any may be off
// by; and the least that is stated, of the tolerance.
inline constexpr double kLawBetween = 2.3, kLawLeastStated = 0.02;
// Tissue that takes more columns has no law. So long a law is sampled in one turn, and so long before what is
// known is shown.
inline constexpr std::size_t kMaxLawColumns = 512;
inline constexpr std::chrono::milliseconds kLawStep{10};
inline constexpr std::chrono::microseconds kLawShown{500};
// How they are sent: windows this near, what is nearest to where the finger will be so much later first, so
// many bytes between two answers.
inline constexpr double kLawReach = 0.060, kLawAhead = 0.1;
inline constexpr std::size_t kLawPieceBytes = 340;
// A new version's law is expected within this: so long the version before answers who feels a law.
inline constexpr std::chrono::milliseconds kLawExpected{300};
// So long the version before answers a finger that would have to wait for a correction of the new one.
inline constexpr std::chrono::milliseconds kArrives{1000};
// A finger that pressed so near so short a time before is answered by what is known, where that is anything.
inline constexpr std::chrono::milliseconds kPressesOn{300};
inline constexpr double kPressesOnM = 0.008;

// Solid tissue (contact/solid_contact.h). Its surface answers as if the block's copies were this far from
// each other at least, in depths of the tissue: nearer ones make it stiffer. The contact is corrected on the
// whole block until its force is known to this, at most so often.
inline constexpr double kMinPeriod = 6.4;
// Columns along z are at most so far apart, whatever the pitch of the slices; and so much tissue lies between
// one end of a block and its other end's copy, at least.
inline constexpr double kSolidSpacing = 0.002, kSolidPadding = 0.016;
inline constexpr double kSolidForceError = 2e-3;
// What a block may be: its elements with those around it, its size along z, columns a side of the tissue as
// wide as kMinPeriod; and the unknowns under a tip.
inline constexpr std::size_t kMaxBlockElements = std::size_t{1} << 20;
inline constexpr double kWidestSolid = 1, kMaxWideColumns = 1024;
inline constexpr std::size_t kMaxPatchUnknowns = 1500;
inline constexpr std::size_t kMaxCorrections = 8;
// The layers of a solid's factor are made anew once ln E0 of one has drifted so far from the others (T8.7). A
// touch farther than this from the nearest slice is of tissue that nobody measured.
inline constexpr double kMaxDrift = 0.02, kSliceReach = 0.005;
// What is known place by place of a slice's ln E is wrong alike over this.
inline constexpr double kLocalCorrelation = 0.005;
// Standard deviation of ln E of such tissue: two of it are a factor of three, which few lumps are beyond.
inline constexpr double kUnseenDeviation = 0.55;

// Of an acquisition that does not state them: standard deviations of the force sensor, of the contact area
// and of the speed of sound, over their values, and of the Poisson ratio; the largest strain that is looked
// for; the Poisson ratio.
inline constexpr double kForceDeviation = 0.03, kAreaDeviation = 0.05, kSoundSpeedDeviation = 0.015;
inline constexpr double kPoissonDeviation = 0.01;
// The same of a capsule's thickness and of its ratio.
inline constexpr double kCapsuleThicknessDeviation = 0.25, kCapsuleRatioDeviation = 0.3;
inline constexpr double kPadDeviation = 0.05;  // of a pad's thickness and modulus
inline constexpr double kMaxStrain = 0.05, kPoissonRatio = 0.49;
// A window is refused when less than this share of its cells was measured.
inline constexpr double kMinMeasuredShare = 0.2;

// A finger that is slower than this leaves the modulus as much time as at this speed: it may turn at any
// moment.
inline constexpr double kSlowFinger = 0.030;
// Of an estimate's textured nodes: below this median correlation the pair is refused.
inline constexpr double kMinMedianCorrelation = 0.6;

}  // namespace teletact::service::choices
