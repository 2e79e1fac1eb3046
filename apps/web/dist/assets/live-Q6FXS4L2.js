import{a,b,c}from"./chunk-JLD3FYXU.js";import"./chunk-KJ45PIP7.js";import"./chunk-YTK2JPDE.js";export{c as Live,b as LiveFigures,a as WALL};
