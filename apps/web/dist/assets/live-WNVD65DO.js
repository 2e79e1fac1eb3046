import{a,b,c}from"./chunk-EXE6MTWK.js";import"./chunk-VU3SZBAD.js";import"./chunk-5PMK3XIH.js";export{c as Live,b as LiveFigures,a as WALL};
