"""List of all schemas. It names classes, not modules, so a schema may move; fingerprints of the codec exclude it."""

from __future__ import annotations

from schemas.affordance import Affordances, FrameLabels, Sample, Samples
from schemas.benchmark import Case, ClipScores, MethodScores, Prediction, Score, Sheet
from schemas.bodies import BodyTasks
from schemas.episodes import ClipsFollowed, GraspEpisodes, GraspExam, GraspJudgement, GraspTrace, TwoTasks, TwoTasksShown
from schemas.files import FileRef, FileTree
from schemas.grasp import GraspCandidates, GraspComparison, GraspObject, GraspObjects, GraspScene, GraspTask, HandCandidates
from schemas.hand import (
    GraspClips,
    GraspTarget,
    HandFingers,
    HandJoints,
    HandMesh,
    HandModel,
    HandMotion,
    HandReference,
    MotionsRead,
    ProvenClips,
    ReferenceSet,
    Retargeted,
    RetargetReport,
    RetargetVerdict,
)
from schemas.hands import DetectedHands, HandLandmarks, HandTracks, MotionRemarks, VideoMotions
from schemas.interaction import (
    ActionClip,
    FlowScore,
    InteractionClip,
    InteractionScores,
    InteractionSpec,
    InteractionTruth,
    RenderedInteraction,
    SceneFlow,
    ShownAnswer,
    StaticSample,
    StaticSet,
)
from schemas.masks import CompleteObjects, Entity, Tracks
from schemas.mesh import MeshParts, MeshReport, ObjectMesh, ObjectSpec, ObjectViews, PartedMesh, ReadMesh, Repair
from schemas.scene import ClipTruth, HandLessons, HandRoom, Mode, Picture, RenderedClip, SceneSpec, Still, Stills, StillSpec
from schemas.spec import Schema
from schemas.surface import (
    DistanceField,
    NegativeAffordance,
    NegativeAffordances,
    NegativeScore,
    NegativeScores,
    PartCandidates,
    PartDescription,
    PartDescriptions,
    PartLessons,
    PartNote,
    PartScores,
    PositiveAffordance,
    PositiveAffordances,
)
from schemas.training import Curve, Recipe, Trained, TrainingLog
from schemas.video import Annotation, Clip, Footage, Frames, Inpainted, KeyFrame, Narration, Polygon

SCHEMAS: tuple[type[Schema], ...] = (
    ActionClip, Affordances, Annotation, BodyTasks, Case, Clip, ClipScores, ClipTruth, ClipsFollowed, CompleteObjects, Curve,
    DetectedHands, DistanceField, Entity, FileRef, FileTree, FlowScore, Footage, FrameLabels, Frames, GraspCandidates,
    GraspClips, GraspComparison, GraspEpisodes, GraspExam, GraspJudgement, GraspObject, GraspObjects, GraspScene,
    GraspTarget, GraspTask, GraspTrace, HandCandidates, HandFingers, HandJoints, HandLandmarks, HandLessons, HandMesh,
    HandModel, HandMotion, HandReference, HandRoom, HandTracks, Inpainted, InteractionClip, InteractionScores,
    InteractionSpec, InteractionTruth, KeyFrame, MeshParts, MeshReport, MethodScores, Mode, MotionRemarks, MotionsRead,
    Narration, NegativeAffordance, NegativeAffordances, NegativeScore, NegativeScores, ObjectMesh, ObjectSpec,
    ObjectViews, PartCandidates, PartDescription, PartDescriptions, PartLessons, PartNote, PartScores, PartedMesh,
    Picture, Polygon, PositiveAffordance, PositiveAffordances, Prediction, ProvenClips, ReadMesh, Recipe, ReferenceSet,
    RenderedClip, RenderedInteraction, Repair, RetargetReport, RetargetVerdict, Retargeted, Sample, Samples, SceneFlow,
    SceneSpec, Score, Sheet, ShownAnswer, StaticSample, StaticSet, Still, StillSpec, Stills, Tracks, Trained,
    TrainingLog, TwoTasks, TwoTasksShown, VideoMotions)  # fmt: skip
