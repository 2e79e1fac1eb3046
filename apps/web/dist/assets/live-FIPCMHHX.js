import{a,b,c}from"./chunk-RBW3MZMN.js";import"./chunk-ENHP4AFT.js";import"./chunk-4TLKO3AS.js";export{c as Live,b as LiveFigures,a as WALL};
