"""Every schema. The codec's code does not include this list, which names classes and not modules: a schema may move."""

from __future__ import annotations

from schemas.affordance import Affordances, FrameLabels
from schemas.benchmark import Case, MethodScores, Sheet
from schemas.candidates import GraspCandidates, GraspScene, HandCandidates
from schemas.clip import Annotation, Clip, Footage, KeyFrame, Narration, Polygon
from schemas.comparison import GraspComparison
from schemas.episodes import ClipsFollowed, GraspEpisodes, GraspExam, GraspJudgement, GraspTrace, TwoTasks, TwoTasksShown
from schemas.files import FileRef, FileTree
from schemas.grasp import GraspObject
from schemas.grasp_task import GraspTask
from schemas.hand import HandFingers, HandJoints, HandMesh, HandModel
from schemas.hand_lessons import HandLessons, HandRoom
from schemas.interaction import (
    ActionClip,
    InteractionClip,
    InteractionSpec,
    InteractionTruth,
    RenderedInteraction,
    StaticSample,
    StaticSet,
)
from schemas.interaction_scores import FlowScore, InteractionScores, ShownAnswer
from schemas.masks import CompleteObjects, Entity, Tracks
from schemas.mesh import MeshParts, MeshReport, ObjectMesh, ObjectSpec, ObjectViews, PartedMesh, ReadMesh, Repair
from schemas.motion import GraspTarget, HandMotion, HandReference, ReferenceSet, Retargeted, RetargetReport, RetargetVerdict
from schemas.negative import (
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
)
from schemas.object_list import GraspObjects
from schemas.positive import PositiveAffordance, PositiveAffordances
from schemas.prediction import Prediction
from schemas.report import ClipScores, Score
from schemas.sample import Sample, Samples
from schemas.scene import RenderedClip, SceneSpec, StillSpec
from schemas.scene_flow import SceneFlow
from schemas.spec import Schema
from schemas.still import Mode, Picture, Still, Stills
from schemas.training import Curve, Recipe, Trained, TrainingLog
from schemas.truth import ClipTruth
from schemas.video import Frames, Inpainted

SCHEMAS: tuple[type[Schema], ...] = (
    ActionClip, Affordances, Annotation, Case, Clip, ClipScores, ClipTruth, ClipsFollowed, CompleteObjects, Curve,
    DistanceField, Entity, FileRef, FileTree, FlowScore, Footage, FrameLabels, Frames, GraspCandidates, GraspComparison,
    GraspEpisodes, GraspExam, GraspJudgement, GraspObject, GraspObjects, GraspScene, GraspTarget, GraspTask, GraspTrace,
    HandCandidates, HandFingers, HandJoints, HandLessons, HandMesh, HandModel, HandMotion, HandReference, HandRoom, Inpainted,
    InteractionClip, InteractionScores, InteractionSpec, InteractionTruth, KeyFrame, MeshParts, MeshReport, MethodScores,
    Mode, Narration, NegativeAffordance, NegativeAffordances, NegativeScore, NegativeScores, ObjectMesh, ObjectSpec,
    ObjectViews, PartCandidates, PartDescription, PartDescriptions, PartLessons, PartNote, PartScores, PartedMesh, Picture,
    Polygon, PositiveAffordance, PositiveAffordances, Prediction, ReadMesh, Recipe, ReferenceSet, RenderedClip,
    RenderedInteraction, Repair, RetargetReport, RetargetVerdict, Retargeted, Sample, Samples, SceneFlow, SceneSpec, Score,
    Sheet, ShownAnswer, StaticSample, StaticSet, Still, StillSpec, Stills, Tracks, Trained, TrainingLog, TwoTasks,
    TwoTasksShown)  # fmt: skip
